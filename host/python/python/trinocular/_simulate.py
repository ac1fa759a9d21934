"""Simulated runs on the twin, and rendered images."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Mapping, Optional, Union

import numpy as np
from numpy.typing import NDArray

from . import _trinocular
from ._arrays import Vector, number, plain, vector, whole
from ._paths import Path, existing
from ._rig import Rig


@dataclass(frozen=True, eq=False)
class Simulation:
    """Run of a scenario on the twin: true positions every millisecond, and figures."""

    #: Time since the keyframe, s; array (n,).
    time_s: NDArray[np.float64]
    #: Position of the target, mm from that at the keyframe; array (n, 3).
    target_mm: NDArray[np.float64]
    #: Position of the cameras by the edges at the step pins, mm; array (n, 3).
    camera_mm: NDArray[np.float64]
    #: Name of the station's state; array (n,) of str.
    states: NDArray[np.str_]
    #: Figures of the run, as ``trinocular simulate --json`` prints them: ``rms_mm``, ``max_mm``...
    figures: dict[str, Any]
    #: Figures without prediction, if the scenario compares them.
    without_prediction: Optional[dict[str, Any]]
    #: Expectations of the scenario that were missed, in words.
    missed: tuple[str, ...]

    @property
    def error_mm(self) -> NDArray[np.float64]:
        """Cameras minus target, mm; array (n, 3)."""
        return self.camera_mm - self.target_mm


def simulate(
    scenario: Union[Path, Mapping[str, Any]],
    *,
    points: bool = False,
    prediction: bool = True,
) -> Simulation:
    """Run a scenario on the built-in twin: the board's own code on virtual time.

    ``scenario`` is the path of a scenario file or a dict with its fields. With ``points`` ideal
    points with noise take the place of rendered images: a hundred times faster. Without
    ``prediction`` the station does not predict, and expectations are not judged. Every run of a
    scenario gives the same numbers. Ctrl-C ends it.

    Raises ValueError with the field that breaks a rule, FileNotFoundError.
    """
    if isinstance(scenario, Mapping):
        try:
            text = json.dumps(scenario, default=plain)
        except (TypeError, ValueError) as error:
            raise type(error)(f"scenario: {error}") from None
        result = _trinocular.simulate(text, None, points, prediction)
    else:
        result = _trinocular.simulate(None, existing(scenario), points, prediction)
    without = result["without_prediction"]
    return Simulation(
        time_s=result["time_s"],
        target_mm=result["target_mm"],
        camera_mm=result["camera_mm"],
        states=np.array(result["states"], dtype=np.str_),
        figures=json.loads(result["figures"]),
        without_prediction=None if without is None else json.loads(without),
        missed=tuple(result["missed"]),
    )


class Scene:
    """Renderer of a poster before the cameras of a rig, with the blur and noise of real images.

    ``seed`` draws another poster. ``depth_mm`` (300 to 2000 is usual) is its distance at zero
    displacement, ``noise_grey`` the standard deviation of the sensor's noise, grey levels.
    """

    def __init__(
        self, rig: Rig, seed: int = 1, *, depth_mm: float = 850.0, noise_grey: float = 2.0
    ) -> None:
        if not isinstance(rig, Rig):
            raise TypeError(f"rig must be a Rig, such as Rig.load(path), not {type(rig).__name__}")
        self._native = _trinocular.Scene(
            rig._native,
            whole(seed, "seed", 0, 2**64 - 1),
            number(depth_mm, "depth_mm", 1, 1e5),
            number(noise_grey, "noise_grey", 0, 128),
        )

    def render(self, displacement_mm: Vector, seed: int = 1) -> NDArray[np.uint8]:
        """Render the poster at a displacement x, y, z in mm: array (cameras, height, width).

        ``seed`` draws the noise: give every instant its own.
        """
        where = vector(displacement_mm, "displacement_mm")
        return np.stack(self._native.render(where, whole(seed, "seed", 0, 2**64 - 1)))
