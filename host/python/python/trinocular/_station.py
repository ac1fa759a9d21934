"""The station that moves the stage."""

from __future__ import annotations

import json
import math
from types import TracebackType
from typing import Any, Callable, Iterable, Iterator, Mapping, Optional, Union

from numpy.typing import NDArray

from . import _trinocular
from ._arrays import Vector, choice, vector, whole
from ._flow import Pivot, Rectangle, pivot_of, regions_of
from ._follow import Followed, Shot, checked, rendered, turns
from ._rig import Rig
from ._simulate import Scene
from ._words import words

#: Longest jog, mm: a longer one is taken for a wrong unit.
LONGEST_MM = 1000.0
#: Farthest position that fits the station's numbers, mm.
FARTHEST_MM = 100_000.0


class Station:
    """Connection to a station, which moves a stage; use it in a ``with`` statement.

    ``port`` is "auto" (the only station on USB), a path such as "/dev/ttyACM0", "tcp://HOST:PORT",
    or "twin" (the one that ``trinocular twin`` simulates). With a ``rig`` the station is configured
    with its [stage] first, and positions are known in mm; without one it keeps its configuration.
    ``fixed`` says that the cameras stand beside the stage, which matters to follow alone. The
    station stops by itself if it does not hear this process for ``heartbeat_ms`` (20 to 10000).

    The end of the ``with`` block, an exception and Ctrl-C stop a stage in motion on its ramp. A
    process that is killed stops it by the missing heartbeat. None of this is an emergency stop:
    that is a button.

    Raises StationError with the cause and what to do next, ValueError for wrong arguments.
    """

    def __init__(
        self,
        port: str,
        rig: Optional[Rig] = None,
        *,
        heartbeat_ms: int = 100,
        fixed: bool = False,
    ) -> None:
        if not isinstance(port, str):
            raise TypeError(f"port must be str, such as \"auto\", not {type(port).__name__}")
        if rig is not None and not isinstance(rig, Rig):
            raise TypeError(f"rig must be a Rig, such as Rig.load(path), not {type(rig).__name__}")
        heartbeat_ms = whole(heartbeat_ms, "heartbeat_ms", 20, 10_000)
        self._twin: Optional[_trinocular.Twin] = None
        self._rig = rig
        native = None if rig is None else rig._native
        self._native = _trinocular.Station(port, native, heartbeat_ms, bool(fixed))

    @classmethod
    def twin(cls, rig: Rig, *, fixed: bool = False) -> "Station":
        """Start a station without hardware, the board's own code with a simulated stage, and
        connect to it. ``rig`` must have a stage. Motions take as long as real ones. Its position
        is zero and known.
        """
        if not isinstance(rig, Rig):
            raise TypeError(f"rig must be a Rig, such as Rig.load(path), not {type(rig).__name__}")
        twin = _trinocular.Twin(rig._native)
        # A simulated stage hits nothing while this computer is busy.
        station = cls(twin.path, rig, heartbeat_ms=10_000, fixed=fixed)
        station._twin = twin
        station.zero()
        return station

    def status(self) -> dict[str, Any]:
        """Return the station's condition: ``state``, ``fault``, ``trust``, ``position_steps``,
        ``position_mm`` and ``target_mm`` (None without a rig), ``next`` (what to do), ...
        """
        status: dict[str, Any] = json.loads(self._native.status())
        return status

    @property
    def position_mm(self) -> Optional[list[float]]:
        """Position of the stage x, y, z, mm; None without a rig."""
        position: Optional[list[float]] = self.status()["position_mm"]
        return position

    def jog(self, x: float = 0.0, y: float = 0.0, z: float = 0.0, *, wait: bool = True) -> None:
        """Move the stage by distances in mm along its axes, -1000 to 1000, and wait until it
        stands. Soft limits shorten the move; while the position is unknown it is slow and short.
        Ctrl-C stops the stage. With ``wait`` False it returns at once; see wait.
        """
        distance = vector((x, y, z), "distance")
        if any(abs(mm) > LONGEST_MM for mm in distance):
            raise ValueError(
                f"distance {distance} must be within {LONGEST_MM:.0f} mm: is it in mm?"
            )
        self._native.jog(distance, wait)

    def move_to(self, position_mm: Vector, *, wait: bool = True) -> None:
        """Move the stage to x, y, z in mm from its zero, and wait until it stands. A stage that
        moves to a position may get the next one. The position must be known: zero or home first.

        Raises ValueError for a position outside the soft limits of the rig's stage.
        """
        position = vector(position_mm, "position_mm")
        if any(abs(mm) > FARTHEST_MM for mm in position):
            raise ValueError(f"position_mm {position} must be within {FARTHEST_MM:.0f} mm")
        self._native.move_to(position, wait)

    def home(self, axes: Optional[str] = None) -> None:
        """Find the home switches of axes such as "xz", Z first, and wait; default is all that have
        a switch in the rig.
        """
        chosen = None
        if axes is not None:
            if not axes or set(axes) - set("xyz"):
                raise ValueError(f"axes {axes!r} must be some of \"xyz\"")
            chosen = [name in axes for name in "xyz"]
        self._native.home(chosen)

    def follow(
        self,
        frames: Iterable[Shot],
        *,
        roi: Union[Rectangle, Mapping[str, Rectangle], None] = None,
        mask: Union[NDArray[Any], Mapping[str, NDArray[Any]], None] = None,
        rotation: Optional[str] = None,
        pivot_mm: Pivot = None,
    ) -> Iterator[Followed]:
        """Follow a target: the stage moves so that the cameras' view stays that of the first
        images, with the station's own prediction; if the cameras stand beside the stage
        (``fixed``), it copies the target's motion.

        ``frames`` yields pairs (time_s, images) as they are taken: the time.monotonic() at which
        the shutters opened, and images as for Flow.measure. The first images that can be a keyframe
        are the view to be kept; each later pair gives a Followed. Pictures that cannot be measured
        are refused there and move nothing; without new ones the stage soon stands. ``roi``,
        ``mask``, ``rotation`` and ``pivot_mm`` as for Flow; images that determine no rotation give
        the displacement alone, unless ``pivot_mm`` is another point than the centroid. Position and
        rig must be known: use home or zero first.

        The stage is stopped when ``frames`` ends, when the loop around is left, and by an
        exception or Ctrl-C; it stays stopped until reset. Raises StationError if the station stops
        or is stopped, ValueError for images of another clock.
        """
        if self._rig is None:
            raise ValueError("follow takes the rig: Station(port, rig)")
        choice(rotation, "rotation", "refuse", "estimate", None)
        regions = regions_of(self._rig, roi, mask)
        with words():
            follower = _trinocular.Follower(
                self._rig._native, regions, rotation, pivot_of(pivot_mm)
            )
        if not hasattr(frames, "__iter__"):
            raise TypeError(f"frames must be an iterable, not {type(frames).__name__}")
        return turns(self._native, follower, frames, self._rig)

    def simulated_frames(
        self,
        scene: Scene,
        target: Callable[[float], Vector],
        *,
        frames_per_s: float = 30.0,
        seconds: float = math.inf,
    ) -> Iterator[Shot]:
        """Render a poster before cameras that the twin's stage carries, for follow.

        ``target`` returns the position of the poster x, y, z in mm, in the cameras' axes, for the
        time since the first images in s: (0, 0, 0) for time 0, if these are the keyframe. Images
        come in real time for ``seconds``; a computer that is too slow for ``frames_per_s`` (0.1 to
        1000) leaves some out.
        Raises ValueError if the station is no twin of this process.
        """
        if self._twin is None:
            raise ValueError("only Station.twin(rig) has a simulated stage; real ones have cameras")
        if not isinstance(scene, Scene):
            raise TypeError(f"scene must be a Scene, not {type(scene).__name__}")
        if not callable(target):
            raise TypeError("target must be a function of the time in s")
        rate, duration = checked(frames_per_s, seconds)
        return rendered(self._twin, scene, target, rate, duration)

    def wait(self) -> None:
        """Wait until the stage stands. Ctrl-C stops it."""
        self._native.wait()

    def zero(self) -> None:
        """Make the present position zero on all axes; moves nothing."""
        self._native.zero()

    def stop(self) -> None:
        """Stop the stage on its ramp, from any thread; it stays stopped until reset."""
        self._native.stop()

    def reset(self) -> None:
        """Let a station that was stopped or has a fault move again; moves nothing."""
        self._native.reset()

    def close(self) -> None:
        """Stop a motion and close the connection."""
        self._native.close()
        self._twin = None

    def __enter__(self) -> "Station":
        return self

    def __exit__(
        self,
        kind: Optional[type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()

    def __reduce__(self) -> Any:
        raise TypeError("a Station cannot be pickled: one process has the port")
