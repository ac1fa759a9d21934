"""Result of a measurement."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Optional

import numpy as np
from numpy.typing import NDArray

from ._words import in_python


def _nan(*shape: int) -> Any:
    return field(default_factory=lambda: np.full(shape, np.nan))


def _no_points() -> NDArray[Any]:
    return points_of(np.empty((0, 0, 2, 2)), np.empty((0, 3)))


def points_of(pixels: NDArray[Any], places_mm: NDArray[Any]) -> NDArray[Any]:
    """Return the structured array of points: pixels (n, cameras, 2, 2), places (n, 3)."""
    cameras = pixels.shape[1]
    kind = np.dtype(
        [
            ("before_px", np.float64, (cameras, 2)),
            ("after_px", np.float64, (cameras, 2)),
            ("place_mm", np.float64, (3,)),
        ]
    )
    points = np.empty(len(pixels), dtype=kind)
    points["before_px"] = pixels[:, :, 0]
    points["after_px"] = pixels[:, :, 1]
    points["place_mm"] = places_mm
    return points


@dataclass(frozen=True, eq=False)
class Measurement:
    """Displacement of the target since the keyframe, or the reason why there is none.

    Numbers of a refused measurement are NaN, so that many can be stacked into one array:
    ``numpy.array([m.displacement_mm for m in measurements])``.
    """

    #: Displacement x, y, z, mm; array (3,). If the rotation is estimated, that of the pivot.
    displacement_mm: NDArray[np.float64] = _nan(3)
    #: Standard deviation of each axis, mm; array (3,). NaN if the method gives none.
    sigma_mm: NDArray[np.float64] = _nan(3)
    #: Covariance of the displacement, mm²; array (3, 3). NaN if the method gives none.
    covariance_mm2: NDArray[np.float64] = _nan(3, 3)
    #: Rotation vector about x, y, z, degrees; array (3,). NaN if it is not estimated.
    rotation_deg: NDArray[np.float64] = _nan(3)
    #: Standard deviation of the rotation about each axis, degrees; array (3,).
    rotation_sigma_deg: NDArray[np.float64] = _nan(3)
    #: Point of the target at the keyframe whose displacement is stated, mm; array (3,).
    pivot_mm: NDArray[np.float64] = _nan(3)
    #: Points that were used: structured array with ``before_px`` and ``after_px`` (cameras, 2),
    #: NaN for a camera that was left out, and ``place_mm`` (3,), the place at the keyframe.
    points: NDArray[Any] = field(default_factory=_no_points, repr=False)
    #: Number of points used; it may be less than ``len(points)`` by those behind the cameras.
    used: int = 0
    #: Number of points that were left out.
    rejected: int = 0
    #: Reason why there is no displacement; None if there is one.
    refused: Optional[str] = None
    #: Sentences about cameras that were left out, bad exposures, or points that do not fit.
    warnings: tuple[str, ...] = ()
    #: Capture time of the images, µs on the clock of their source; 0 if it was not given.
    time_us: int = 0

    def __bool__(self) -> bool:
        """Return True if there is a displacement."""
        return self.refused is None


def measurement(result: dict[str, Any], time_us: int = 0) -> Measurement:
    """Wrap a native result."""
    numbers = {
        name: np.array(result[name], dtype=np.float64)
        for name in (
            "displacement_mm",
            "sigma_mm",
            "covariance_mm2",
            "rotation_deg",
            "rotation_sigma_deg",
            "pivot_mm",
        )
        if result.get(name) is not None
    }
    refused = result.get("refused")
    return Measurement(
        points=points_of(result["pixels"], result["places_mm"]),
        used=result.get("used", 0),
        rejected=result.get("rejected", 0),
        refused=None if refused is None else in_python(refused),
        warnings=tuple(in_python(warning) for warning in result["warnings"]),
        time_us=time_us,
        **numbers,
    )
