"""The station that moves the stage."""

from __future__ import annotations

import json
from types import TracebackType
from typing import Any, Optional, Sequence

from . import _trinocular
from ._arrays import vector, whole
from ._rig import Rig

#: Longest jog, mm: a longer one is taken for a wrong unit.
LONGEST_MM = 1000.0
#: Farthest position that fits the station's numbers, mm.
FARTHEST_MM = 100_000.0


class Station:
    """Connection to a station, which moves a stage; use it in a ``with`` statement.

    ``port`` is "auto" (the only station on USB), a path such as "/dev/ttyACM0", "tcp://HOST:PORT",
    or "twin" (the one that ``trinocular twin`` simulates). With a ``rig`` the station is configured
    with its [stage] first, and positions are known in mm; without one it keeps its configuration.
    The station stops by itself if it does not hear this process for ``heartbeat_ms`` (20 to 10000).

    The end of the ``with`` block, an exception and Ctrl-C stop a stage in motion on its ramp. A
    process that is killed stops it by the missing heartbeat. None of this is an emergency stop:
    that is a button.

    Raises StationError with the cause and what to do next, ValueError for wrong arguments.
    """

    def __init__(self, port: str, rig: Optional[Rig] = None, *, heartbeat_ms: int = 100) -> None:
        if not isinstance(port, str):
            raise TypeError(f"port must be str, such as \"auto\", not {type(port).__name__}")
        if rig is not None and not isinstance(rig, Rig):
            raise TypeError(f"rig must be a Rig, such as Rig.load(path), not {type(rig).__name__}")
        heartbeat_ms = whole(heartbeat_ms, "heartbeat_ms", 20, 10_000)
        self._twin: Optional[_trinocular.Twin] = None
        native = None if rig is None else rig._native
        self._native = _trinocular.Station(port, native, heartbeat_ms)

    @classmethod
    def twin(cls, rig: Rig) -> "Station":
        """Start a station without hardware, the board's own code with a simulated stage, and
        connect to it. ``rig`` must have a stage. Motions take as long as real ones. Its position
        is zero and known.
        """
        if not isinstance(rig, Rig):
            raise TypeError(f"rig must be a Rig, such as Rig.load(path), not {type(rig).__name__}")
        twin = _trinocular.Twin(rig._native)
        # A simulated stage hits nothing while this computer is busy.
        station = cls(twin.path, rig, heartbeat_ms=10_000)
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

    def move_to(self, position_mm: Sequence[float], *, wait: bool = True) -> None:
        """Move the stage to x, y, z in mm from its zero, and wait until it stands. A stage that
        moves to a position may get the next one. The position must be known: zero or home first.
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
