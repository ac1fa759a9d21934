"""Displacements in mm from the images of parallel cameras, and a stage that follows.

Units are in the names: ``_mm``, ``_px``, ``_deg``, ``_us``. Axes: x right, y down, z away from the
cameras. Images are arrays (cameras, height, width) of uint8 or uint16, in the order of
``Rig.names``.

>>> import trinocular as t
>>> rig = t.Rig.paper()
>>> scene = t.Scene(rig)
>>> m = t.measure(scene.render((0, 0, 0)), scene.render((4, 0, 0)), rig)
>>> bool(abs(m.displacement_mm[0] - 4) < 0.05)
True

A bad picture is no exception: ``Measurement.refused`` says why there is no number. Bad arguments
raise ``TypeError`` or ``ValueError``, a stage that refuses raises ``StationError``.
"""

from ._calibrate import Calibration, calibrate
from ._flow import Flow, estimate, measure
from ._follow import Followed
from ._measurement import Measurement
from ._recording import Frame, Recording, read
from ._rig import Rig
from ._simulate import Scene, Simulation, simulate
from ._station import Station
from ._trinocular import StationError, __version__

__all__ = [
    "Calibration",
    "Flow",
    "Followed",
    "Frame",
    "Measurement",
    "Recording",
    "Rig",
    "Scene",
    "Simulation",
    "Station",
    "StationError",
    "__version__",
    "calibrate",
    "estimate",
    "measure",
    "read",
    "simulate",
]
