"""Checks and conversions of arrays that callers give."""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Any, Optional, Sequence, Union

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ._recording import Frame
    from ._rig import Rig

#: Images of all cameras: an array (cameras, height, width), a sequence of arrays (height, width)
#: with None for a camera that gave no image, or a Frame of a recording.
Images = Union[NDArray[Any], Sequence[Optional[NDArray[Any]]], "Frame"]

#: Three numbers: x, y, z.
Vector = Union[Sequence[float], NDArray[Any]]

WAY_OUT = "use uint8 or uint16, as the camera gives them"


def grey(array: object, what: str) -> NDArray[Any]:
    """Return an array of uint8 or uint16 as contiguous rows in this computer's byte order."""
    if isinstance(array, np.ma.MaskedArray):
        raise TypeError(f"{what}: masked arrays have no meaning here; use Flow(..., mask=...)")
    try:
        found = np.asarray(array)
    except ValueError as error:
        raise ValueError(f"{what}: not an array of numbers: {error}") from None
    kind = found.dtype
    if kind == np.uint8 or (kind.kind == "u" and kind.itemsize == 2):
        return np.ascontiguousarray(found, dtype=kind.newbyteorder("="))
    if kind.kind == "f":
        hint = (
            "scale them yourself, for instance (255 * a).astype(numpy.uint8) for values from 0 to "
            "1, because their full scale is not known"
        )
        raise TypeError(f"{what}: images of {kind} are not taken; {hint}")
    if kind.kind in "iu" and not isinstance(array, np.ndarray):
        # Lists of Python's integers have no depth of their own.
        if found.size and (found.min() < 0 or found.max() > 65_535):
            raise ValueError(f"{what}: values must be 0 to 65535; {WAY_OUT}")
        deep = found.size > 0 and found.max() > 255
        return np.ascontiguousarray(found, dtype=np.uint16 if deep else np.uint8)
    raise TypeError(f"{what}: images of {kind} are not taken; {WAY_OUT}")


def images(given: object, rig: "Rig", what: str) -> list[Optional[NDArray[Any]]]:
    """Return one array (height, width) per camera, None for a camera without an image."""
    from ._recording import Frame

    if isinstance(given, Frame):
        given = given.images
    names = rig.names
    width, height = rig.image_size_px
    form = f"({len(names)}, {height}, {width}): cameras, height, width"
    if isinstance(given, (str, bytes, bytearray)) or not hasattr(given, "__len__"):
        raise TypeError(f"{what} must be an array {form}, not {type(given).__name__}")
    if not isinstance(given, (list, tuple, np.ndarray)):
        # Arrays of other libraries, and buffers.
        given = np.asarray(given)
    if isinstance(given, np.ndarray):
        views: list[object] = list(given) if given.ndim else [given]
        if given.ndim != 3:
            raise ValueError(
                f"{what} has the shape {given.shape}; it must be {form}{hint(given, rig)}"
            )
        grey(given[:0], what)
    else:
        views = list(given)
    if len(views) != len(names):
        raise ValueError(
            f"{what} has images of {len(views)} cameras; the rig has {len(names)}: "
            f"{', '.join(names)}{hint(given, rig) if isinstance(given, np.ndarray) else ''}"
        )
    result: list[Optional[NDArray[Any]]] = []
    for name, view in zip(names, views):
        if view is None:
            result.append(None)
            continue
        image = grey(view, f"{what}, camera {name}")
        if image.shape != (height, width):
            raise ValueError(
                f"{what}, camera {name}: the image has the shape {image.shape}; the rig's images "
                f"are ({height}, {width}): height, width{hint(image, rig)}"
            )
        result.append(image)
    if all(image is None for image in result):
        raise ValueError(f"{what}: no camera has an image")
    return result


def hint(array: NDArray[Any], rig: "Rig") -> str:
    """Return the likely mistake behind a wrong shape."""
    width, height = rig.image_size_px
    if array.shape[-2:] == (width, height) and width != height:
        return "; rows and columns are exchanged: use numpy.swapaxes(a, -1, -2)"
    if array.ndim == 3 and array.shape == (height, width, len(rig.names)):
        return (
            "; if the last axis is the camera, use numpy.moveaxis(a, -1, 0); if it is the colour, "
            "convert it to grey"
        )
    if array.ndim >= 3 and array.shape[-1] in (3, 4) and array.shape[-3:-1] == (height, width):
        return "; convert colour to grey first"
    return ""


def plain(value: object) -> Any:
    """Return values of numpy as those of Python, for json.dumps."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"{value!r} is neither a number, a text, a list nor a dict")


def number(given: object, what: str, least: float, most: float) -> float:
    """Return a number within bounds, both included."""
    try:
        found = float(given)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise TypeError(f"{what} must be a number, not {given!r}") from None
    if isinstance(given, (str, bytes)) or not least <= found <= most:
        raise ValueError(f"{what} {given!r} must be a number from {least:g} to {most:g}")
    return found


def whole(given: object, what: str, least: int, most: int) -> int:
    """Return a whole number within bounds, both included."""
    try:
        found = operator.index(given)  # type: ignore[arg-type]
    except TypeError:
        raise TypeError(f"{what} must be a whole number, not {given!r}") from None
    if not least <= found <= most:
        raise ValueError(f"{what} {given!r} must be {least} to {most}")
    return found


def choice(given: object, what: str, *choices: Optional[str]) -> None:
    """Refuse what is none of the choices."""
    if not (given is None or isinstance(given, str)) or given not in choices:
        known = " or ".join(repr(one) for one in choices)
        kind = ValueError if isinstance(given, str) else TypeError
        raise kind(f"{what} {given!r} is unknown; use {known}")


def vector(given: object, what: str) -> tuple[float, float, float]:
    """Return three finite numbers."""
    try:
        found = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"{what} must be three numbers, not {given!r}") from None
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ValueError(f"{what} must be three finite numbers, not {given!r}")
    return (float(found[0]), float(found[1]), float(found[2]))
