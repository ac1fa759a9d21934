"""Calibration from photographs of a chessboard."""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass
from typing import Any, Mapping, Optional, Sequence, Union

from numpy.typing import NDArray

from . import _trinocular
from ._arrays import choice, grey, number, whole
from ._paths import Path, existing
from ._rig import Rig
from ._words import in_python, words


@dataclass(frozen=True)
class Calibration:
    """Calibrated cameras with their places in the rig, every number with its standard deviation."""

    #: The rig; None for a single camera.
    rig: Optional[Rig]
    #: One dict per camera: ``camera``, ``focal_px``, ``focal_sigma_px``, ``principal_px``,
    #: ``distortion``, ``rms_px``, ``images`` with the residual or the reason of a rejection, ...
    cameras: list[dict[str, Any]]
    #: Places of the cameras with their standard deviations, and the instants that were used; None
    #: for a single camera.
    places: Optional[dict[str, Any]]
    #: Sentences about what is doubtful.
    warnings: tuple[str, ...]


def calibrate(
    images: Union[Path, Mapping[str, Sequence[Optional[NDArray[Any]]]]],
    board: Sequence[int],
    square_mm: float,
    *,
    outlier: float = 3.0,
    window: Optional[int] = None,
    pair: Optional[str] = None,
) -> Calibration:
    """Calibrate cameras and rig from photographs of a chessboard.

    ``images`` is a folder as ``trinocular calibrate`` takes it, or a dict from the camera's name to
    its images, arrays (height, width) of uint8 or uint16; images of equal index are of one instant,
    None stands for an image that a camera did not take. ``board`` is the number of inner corners
    along the two sides, such as (9, 6), ``square_mm`` the side of a square. Images whose residual
    is larger than ``outlier`` times the median's are rejected. ``window`` (2 to 50 px) is half the
    window in which corners are refined; default follows the squares. ``pair`` is "name", "order" or
    "time", the rule by which files are of one instant.

    Ctrl-C ends it. Raises ValueError with the reason if the images make no rig.
    """
    if isinstance(board, str) or not hasattr(board, "__len__") or len(board) != 2:
        raise ValueError(f"board {board!r} must be two numbers of inner corners: (9, 6)")
    corners = [whole(count, "board", 2, 100) for count in board]
    square_mm = number(square_mm, "square_mm", 1e-6, 1e5)
    outlier = number(outlier, "outlier", 1, 1e5)
    window = None if window is None else whole(window, "window", 2, 50)
    choice(pair, "pair", "name", "order", "time", None)
    options = (corners, square_mm, outlier, window, pair)
    if not isinstance(images, Mapping):
        with words():
            return _calibration(_trinocular.calibrate(existing(images), *options))
    if not images:
        raise ValueError("images: no camera; give a dict from names to lists of images")
    with tempfile.TemporaryDirectory() as folder:
        for name, views in images.items():
            if not name or name.startswith(".") or "/" in name or "\\" in name:
                raise ValueError(f"camera {name!r}: the name must be one of a folder")
            for index, view in enumerate(views):
                if view is None:
                    continue
                what = f"images, camera {name}, index {index}"
                image = grey(view, what)
                if image.ndim != 2 or image.size == 0:
                    raise ValueError(
                        f"{what}: the shape is {image.shape}; it must be (height, width)"
                    )
                _trinocular.save(folder, name, index, image)
        try:
            with words():
                return _calibration(_trinocular.calibrate(folder, *options))
        except ValueError as error:
            # The folder is not the caller's.
            raise ValueError(str(error).replace(folder, "images")) from None


def _calibration(result: tuple[Any, str, list[str]]) -> Calibration:
    native, text, warnings = result
    objects = json.loads(text)
    places = [one["rig"] for one in objects if "rig" in one]
    return Calibration(
        rig=None if native is None else Rig._of(native),
        cameras=[one for one in objects if "rig" not in one],
        places=places[0] if places else None,
        warnings=tuple(in_python(warning) for warning in warnings),
    )
