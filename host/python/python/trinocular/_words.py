"""Sentences of the command line in the words of this package."""

from __future__ import annotations

import re
import warnings
from contextlib import contextmanager
from typing import Iterable, Iterator

_REPLACED = [
    (re.compile(r"--topic (\S+)=(/[^\s;,]+)"), r'topics={"\1": "\2"}'),
    (re.compile(r"--(rotation|pair|method) ([a-z-]+)"), r'\1="\2"'),
    (re.compile(r"--offset (\S+)=X,Y \(mm\)"), r'offsets_mm={"\1": (X, Y)}'),
    (re.compile(r"--offset (\S+):"), r"offsets_mm of \1:"),
    (re.compile(r"--image-size( WIDTHxHEIGHT)?"), "image_size_px"),
    (re.compile(r"--pivot ([a-z]+)"), r'pivot_mm="\1"'),
    (re.compile(r"--pivot"), "pivot_mm"),
    (re.compile(r"--square"), "square_mm"),
    (re.compile(r"--topic"), "topics"),
]


def in_python(sentence: str) -> str:
    """Return a sentence with the names of this package's arguments.

    >>> in_python("to measure it: --rotation estimate")
    'to measure it: rotation="estimate"'
    >>> in_python("name it with --topic left=/TOPIC")
    'name it with topics={"left": "/TOPIC"}'
    >>> in_python("name it with --topic left=/TOPIC; no topic has images")
    'name it with topics={"left": "/TOPIC"}; no topic has images'
    >>> in_python("does not say where the camera is; give --offset left=X,Y (mm)")
    'does not say where the camera is; give offsets_mm={"left": (X, Y)}'
    """
    for pattern, words_here in _REPLACED:
        sentence = pattern.sub(words_here, sentence)
    return sentence


def warn(doubts: Iterable[str]) -> None:
    """Warn the caller of the package, two calls up, of what is probably a mistake."""
    for doubt in doubts:
        warnings.warn(in_python(doubt), UserWarning, stacklevel=3)


@contextmanager
def words() -> Iterator[None]:
    """Raise a ValueError of the native half with the names of this package's arguments."""
    try:
        yield
    except ValueError as error:
        raise ValueError(in_python(str(error))) from None
