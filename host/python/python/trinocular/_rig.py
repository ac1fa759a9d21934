"""Rigs."""

from __future__ import annotations

import json
import os
from typing import Any, Mapping, Optional, Sequence, Union

from . import _trinocular
from ._arrays import plain, vector
from ._paths import Path, existing

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
        """Read a rig file (TOML).

        Raises ValueError with file, line and field if the file breaks a rule, FileNotFoundError if
        there is none.
        """
        return cls._of(_trinocular.Rig.load(existing(path)))

    @classmethod
    def paper(cls) -> "Rig":
        """Return the rig of the paper: three cameras in line, 320 x 240 px, no stage."""
        return cls._of(_trinocular.Rig.paper())

    @classmethod
    def from_toml(cls, text: str) -> "Rig":
        """Read the text of a rig file. Raises ValueError with line and field."""
        return cls._of(_trinocular.Rig.from_toml(text))

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> "Rig":
        """Make a rig from the fields of a rig file, as to_dict gives them.

        Raises ValueError with the field that breaks a rule.
        """
        if not isinstance(fields, Mapping):
            found = type(fields).__name__
            raise TypeError(f"fields must be a dict as to_dict gives it, not {found}")
        try:
            text = json.dumps(fields, default=plain)
        except (TypeError, ValueError) as error:
            raise type(error)(f"fields: {error}") from None
        return cls._of(_trinocular.Rig.from_json(text))

    @classmethod
    def from_opencv(
        cls,
        path: Union[Path, Sequence[Path]],
        offsets_mm: Optional[Mapping[str, Sequence[float]]] = None,
    ) -> "Rig":
        """Assemble a rig from calibrations of OpenCV (FileStorage: YAML, JSON, XML) or ROS.

        ``path`` is a folder with one file per camera, or the list of the files; the file's name is
        the camera's name. ``offsets_mm`` gives the place of a camera, right and down of the origin
        in mm, if its file has none: ``{"left": (0, 0), "right": (68, 0)}``.

        Raises ValueError with file, line and field, FileNotFoundError.
        """
        if isinstance(path, (str, os.PathLike)):
            folder = existing(path)
            if not os.path.isdir(folder):
                raise ValueError(
                    f"{folder}: one file holds one camera; give the folder or the list of the "
                    "files of all cameras"
                )
            names = sorted(name for name in os.listdir(folder) if name.lower().endswith(_ENDINGS))
            files = [os.path.join(folder, name) for name in names]
        else:
            files = [existing(file) for file in path]
        if not 2 <= len(files) <= 8:
            raise ValueError(f"{len(files)} files of cameras found; a rig has 2 to 8")
        offsets = [
            (name, vector((*place, 0.0), f"offsets_mm of {name}")[:2])
            for name, place in (offsets_mm or {}).items()
        ]
        return cls._of(_trinocular.Rig.assemble(files, offsets))

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

    def project(self, place_mm: Sequence[float]) -> list[list[float]]:
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
        return (Rig.from_toml, (self.to_toml(),))
