"""Sentences of the command line in the words of this package."""

from __future__ import annotations

import re
from contextlib import contextmanager
from typing import Iterator

_TOPIC = re.compile(r"--topic (\S+)=(/\S+)")
_OPTION = re.compile(r"--(rotation|pair) ([a-z]+)")


def in_python(sentence: str) -> str:
    """Return a sentence with the names of this package's arguments.

    >>> in_python("to measure it: --rotation estimate")
    'to measure it: rotation="estimate"'
    >>> in_python("name it with --topic left=/TOPIC")
    'name it with topics={"left": "/TOPIC"}'
    """
    sentence = _TOPIC.sub(r'topics={"\1": "\2"}', sentence)
    return _OPTION.sub(r'\1="\2"', sentence).replace("--topic", "topics")


@contextmanager
def words() -> Iterator[None]:
    """Raise a ValueError of the native half with the names of this package's arguments."""
    try:
        yield
    except ValueError as error:
        raise ValueError(in_python(str(error))) from None
