"""The closed loop: frame sets from Python, and a station that follows the target in them."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any, Callable, Iterable, Iterator, Optional

import numpy as np
from numpy.typing import NDArray

from . import _trinocular
from ._arrays import Images, Vector, images, number, vector
from ._measurement import Measurement, measurement
from ._rig import Rig
from ._simulate import Scene
from ._words import in_python

#: Images of one instant: seconds of time.monotonic() when they were taken, and the images.
Shot = tuple[float, Images]

#: Oldest images that a station may get, s.
OLDEST_S = 10.0
#: Longest lead of a capture time over the clock, s: it is rounded to microseconds.
AHEAD_S = 0.001
#: Readings of two clocks, of which the closest counts.
READINGS = 5


@dataclass(frozen=True, eq=False)
class Followed:
    """One turn of the loop: what the station saw in a frame set, and where its stage stands."""

    #: Capture time as it was given, s.
    time_s: float
    #: Displacement of the target since the keyframe as the cameras see it, computed by the station.
    #: ``refused`` if the images could not be measured, or the station did not use them.
    measurement: Measurement
    #: Position of the stage x, y, z by the station's latest report, mm; array (3,).
    stage_mm: NDArray[np.float64]
    #: Time from the images to the first step that they could change, ms; None if refused.
    latency_ms: Optional[float]

    @property
    def refused(self) -> Optional[str]:
        """Reason why the frame set had no effect; None if the station used it."""
        return self.measurement.refused

    def __bool__(self) -> bool:
        """Return True if the station used the frame set."""
        return self.refused is None


def turns(
    station: _trinocular.Station,
    follower: _trinocular.Follower,
    shots: Iterable[Shot],
    rig: Rig,
) -> Iterator[Followed]:
    """Follow the target; stop the stage at the end, whatever ends it."""
    offset_us = _offset_us(station)
    has_keyframe = False
    try:
        for shot in shots:
            time_s, given = _shot(shot)
            unread = getattr(given, "refused", None)
            if unread is not None:
                yield _refused(time_s, str(unread), station)
                continue
            taken_us = round(time_s * 1e6) + offset_us
            now = images(given, rig, "images")
            if not has_keyframe:
                reason = follower.keyframe(station, now, taken_us)
                has_keyframe = reason is None
                if reason is not None:
                    reason = f"cannot be the keyframe: {in_python(reason)}"
                    yield _refused(time_s, reason, station)
                continue
            result = follower.turn(station, now, taken_us)
            latency_us = result["latency_us"]
            yield Followed(
                time_s=time_s,
                measurement=measurement(result, max(0, round(time_s * 1e6))),
                stage_mm=np.array(result["stage_mm"], dtype=np.float64),
                latency_ms=None if latency_us is None else latency_us * 1e-3,
            )
    finally:
        station.stop_motion()


def _refused(time_s: float, reason: str, station: _trinocular.Station) -> Followed:
    stage_mm = np.array(station.position_mm(), dtype=np.float64)
    refused = Measurement(refused=reason, time_us=max(0, round(time_s * 1e6)))
    return Followed(time_s, refused, stage_mm, None)


def _shot(shot: object) -> tuple[float, Any]:
    """Return capture time and images of a shot; refuse other clocks."""
    if not isinstance(shot, tuple) or len(shot) != 2:
        raise TypeError(
            "follow takes pairs (time_s, images), with the time.monotonic() at which the images "
            f"were taken, not {type(shot).__name__}"
        )
    time_s = number(shot[0], "time_s", -math.inf, math.inf)
    age_s = time.monotonic() - time_s
    if not -AHEAD_S <= age_s <= OLDEST_S:
        when = f"{age_s:g} s ago" if age_s > 0 else f"{-age_s:g} s in the future"
        raise ValueError(
            f"time_s {time_s:g} is {when} by time.monotonic(), which must be the clock of the "
            f"images; they may be {OLDEST_S:g} s old"
        )
    return time_s, shot[1]


def _offset_us(station: _trinocular.Station) -> int:
    """Return the clock of the station's line minus time.monotonic(), µs."""
    readings = []
    for _ in range(READINGS):
        before_ns = time.monotonic_ns()
        there_us = station.now_us()
        after_ns = time.monotonic_ns()
        readings.append((after_ns - before_ns, there_us - (before_ns + after_ns) // 2_000))
    return min(readings)[1]


def rendered(
    twin: _trinocular.Twin,
    scene: Scene,
    target: Callable[[float], Vector],
    frames_per_s: float,
    seconds: float,
) -> Iterator[Shot]:
    """Render the poster before cameras on the twin's stage, in real time."""
    matrix = np.array(twin.matrix)
    due_s, start_s, seed = 0.0, None, 0
    while due_s <= seconds:
        if start_s is not None:
            time.sleep(max(0.0, start_s + due_s - time.monotonic()))
        stage_mm, age_s = twin.position()
        taken_s = time.monotonic() - age_s
        start_s = taken_s if start_s is None else start_s
        there_mm = vector(target(taken_s - start_s), "target")
        seed += 1
        yield taken_s, scene.render(there_mm - np.linalg.solve(matrix, stage_mm), seed=seed)
        # A computer that is late leaves images out.
        late = (time.monotonic() - start_s) * frames_per_s
        due_s = max(due_s * frames_per_s + 1, math.ceil(late)) / frames_per_s


def checked(frames_per_s: object, seconds: object) -> tuple[float, float]:
    """Return rate and duration within their bounds."""
    return (
        number(frames_per_s, "frames_per_s", 0.1, 1_000),
        number(seconds, "seconds", 0, math.inf),
    )
