"""Paths that callers give."""

from __future__ import annotations

import errno
import os
from typing import Union

Path = Union[str, "os.PathLike[str]"]


def existing(path: Path) -> str:
    """Return the path as text; raise FileNotFoundError if there is nothing."""
    text = os.fspath(path)
    if not isinstance(text, str):
        raise TypeError(f"a path must be str or os.PathLike, not {type(path).__name__}")
    if not os.path.exists(text):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), text)
    return text
