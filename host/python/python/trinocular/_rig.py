"""Rigs."""

from __future__ import annotations

import json
import os
from typing import Any, Mapping, Optional, Sequence, Union

from . import _trinocular
from ._arrays import Vector, plain, vector, whole
from ._paths import Path, existing
from ._words import warn, words

_ENDINGS = (".yml", ".yaml", ".json", ".xml", ".ini", ".gz")


class Rig:
    """Cameras of a rig with their lenses and places, and the stage if the rig file has one.

    Lengths are mm, image positions px from the centre of the top left pixel. A rig does not
    change; it can be compared, hashed, copied and pickled.

    >>> rig = Rig.paper()
    >>> rig.names, rig.image_size_px
    (['left', 'middle', 'right'], (320, 240))
    """

    __slots__ = ("_native",)
    _native: _trinocular.Rig

    def __init__(self) -> None:
        raise TypeError(
            "use Rig.load(path), Rig.from_opencv(path), Rig.from_dict(d) or Rig.paper()"
        )

    @classmethod
    def _of(cls, native: _trinocular.Rig) -> "Rig":
        rig = cls.__new__(cls)
        object.__setattr__(rig, "_native", native)
        return rig

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError("a Rig does not change; make another with Rig.from_dict")

    @classmethod
    def load(cls, path: Path) -> "Rig":
        """Read a rig file (TOML). Warns of probable mistakes, such as offsets in metres.

        Raises ValueError with file, line and field if the file breaks a rule, FileNotFoundError if
        there is none.
        """
        rig = cls._of(_trinocular.Rig.load(existing(path)))
        warn(rig._native.doubts())
        return rig

    @classmethod
    def paper(cls) -> "Rig":
        """Return the rig of the paper: three cameras in line, 320 x 240 px, no stage."""
        return cls._of(_trinocular.Rig.paper())

    @classmethod
    def from_toml(cls, text: str) -> "Rig":
        """Read the text of a rig file. Warns as load does.

        Raises ValueError with line and field.
        """
        rig = cls._of(_trinocular.Rig.from_toml(text))
        warn(rig._native.doubts())
        return rig

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> "Rig":
        """Make a rig from the fields of a rig file, as to_dict gives them. Warns as load does.

        Raises ValueError with the field that breaks a rule.
        """
        if not isinstance(fields, Mapping):
            found = type(fields).__name__
            raise TypeError(f"fields must be a dict as to_dict gives it, not {found}")
        try:
            text = json.dumps(fields, default=plain)
        except (TypeError, ValueError) as error:
            raise type(error)(f"fields: {error}") from None
        rig = cls._of(_trinocular.Rig.from_json(text))
        warn(rig._native.doubts())
        return rig

    @classmethod
    def from_opencv(
        cls,
        path: Union[Path, Sequence[Path]],
        offsets_mm: Optional[Mapping[str, Sequence[float]]] = None,
        *,
        image_size_px: Optional[Sequence[int]] = None,
    ) -> "Rig":
        """Assemble a rig from calibrations of OpenCV, ROS, Kalibr or MATLAB, as ``trinocular
        convert`` does.

        ``path`` is a folder with one file per camera, or the list of the files: the YAML, JSON or
        XML of OpenCV's FileStorage, ROS's camera_info, MATLAB's Calib_Results.m; the file's name is
        the camera's name. A Kalibr camchain is one file with all cameras, and the pair that
        OpenCV's stereo_calib writes (intrinsics, extrinsics) takes the images' ``image_size_px``
        (width, height), which it lacks. ``offsets_mm`` gives the place of a camera, right and down
        of the origin in mm, if its file has none: ``{"left": (0, 0), "right": (68, 0)}``.

        Warns of probable mistakes, such as offsets in metres. Raises ValueError with file, line and
        field, FileNotFoundError.
        """
        files = _files(path)
        offsets = [
            (name, vector((*place, 0.0), f"offsets_mm of {name}")[:2])
            for name, place in (offsets_mm or {}).items()
        ]
        size = None
        if image_size_px is not None:
            if isinstance(image_size_px, str) or not hasattr(image_size_px, "__len__"):
                raise TypeError(f"image_size_px {image_size_px!r} must be width and height")
            if len(image_size_px) != 2:
                raise ValueError(f"image_size_px {image_size_px!r} must be width and height")
            width, height = (whole(side, "image_size_px", 8, 65_535) for side in image_size_px)
            size = (width, height)
        with words():
            native, doubts = _trinocular.Rig.assemble(files, offsets, size)
        warn([*doubts, *native.doubts()])
        return cls._of(native)

    def to_toml(self) -> str:
        """Return the text of the rig file; from_toml reads the same rig back, bit for bit."""
        return self._native.to_toml()

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of the rig file.

        >>> Rig.paper().to_dict()["camera"][0]["name"]
        'left'
        """
        fields: dict[str, Any] = json.loads(self._native.to_json())
        return fields

    def save(self, path: Path) -> None:
        """Write the rig file, whole or not at all; replaces an existing file.

        Raises ValueError with the cause if it cannot be written.
        """
        self._native.save(os.fspath(path))

    @property
    def names(self) -> list[str]:
        """Names of the cameras, in the order of all arrays."""
        return self._native.names

    @property
    def image_size_px(self) -> tuple[int, int]:
        """Width and height of every image, px. Arrays are (height, width)."""
        return self._native.image_size_px

    @property
    def has_stage(self) -> bool:
        """True if the rig describes a stage."""
        return self._native.has_stage

    def project(self, place_mm: Vector) -> list[list[float]]:
        """Return the pixel [x, y] at which each camera sees a place x, y, z, mm.

        Raises ValueError for a place behind the cameras.
        """
        return self._native.project(vector(place_mm, "place_mm"))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rig) and self._native == other._native

    def __hash__(self) -> int:
        return hash(self._native.to_toml())

    def __repr__(self) -> str:
        return repr(self._native)

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return (_restored, (self.to_toml(),))


def _restored(text: str) -> Rig:
    """Return a rig that was pickled; its maker has been warned."""
    return Rig._of(_trinocular.Rig.from_toml(text))


def _files(path: Union[Path, Sequence[Path]]) -> list[str]:
    """Return the files of a folder, of a list, or the one file with all cameras."""
    if not isinstance(path, (str, os.PathLike)):
        return [existing(file) for file in path]
    found = existing(path)
    if not os.path.isdir(found):
        return [found]
    names = sorted(name for name in os.listdir(found) if name.lower().endswith(_ENDINGS))
    if not names:
        raise ValueError(f"{found}: holds no file of a camera ({', '.join(_ENDINGS)})")
    return [os.path.join(found, name) for name in names]
