"""Recordings, bags and folders of images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Iterator, Mapping, Optional

import numpy as np
from numpy.typing import NDArray

from . import _trinocular
from ._arrays import choice, number
from ._paths import Path, existing
from ._rig import Rig
from ._words import in_python, warn, words

if TYPE_CHECKING:
    import pandas
    import polars


@dataclass(frozen=True, eq=False)
class Frame:
    """Images of all cameras at one instant."""

    #: Capture time, µs on the clock of the source.
    time_us: int
    #: One array (height, width) of uint8 per camera, in the rig's order; None for a camera that
    #: gave no image.
    images: tuple[Optional[NDArray[np.uint8]], ...]
    #: Reason why the images cannot be read; None if they can. There are no images then.
    refused: Optional[str] = None


class Recording:
    """Frame sets of a recording, a bag or a folder; make it with read.

    It can be iterated as often as wanted, each time from the beginning. The files are read as the
    iteration goes on, so that a recording may be larger than the memory.
    """

    def __init__(self, native: _trinocular.Source, path: str) -> None:
        self._native = native
        self._path = path

    @property
    def rig(self) -> Rig:
        """The rig of the images: the one that was given, or that of the recording."""
        return Rig._of(self._native.rig)

    @property
    def warnings(self) -> list[str]:
        """Sentences about files that are not read, or a recording that was cut off."""
        return [in_python(warning) for warning in self._native.warnings]

    def __iter__(self) -> Iterator[Frame]:
        with words():
            frames = self._native.frames()
        while True:
            frame = frames.next()
            if frame is None:
                return
            time_us, images, refused = frame
            yield Frame(time_us, tuple(images), refused)

    def to_numpy(self) -> NDArray[Any]:
        """Return the measurements that a run recorded, one row per frame set: a structured array
        with the columns of ``trinocular export --csv`` (``x_mm``, ``sigma_x_mm``, ``outcome``...).

        Cells that a frame set does not have are NaN or empty. Raises ValueError for a folder or a
        recording of another program, which hold no measurements.
        """
        columns = {
            name: values if isinstance(values, np.ndarray) else np.array(values, dtype=np.str_)
            for name, values in self._native.table().items()
        }
        kinds = [(name, values.dtype) for name, values in columns.items()]
        rows = np.empty(len(columns["frame"]), dtype=kinds)
        for name, values in columns.items():
            rows[name] = values
        return rows

    def to_pandas(self) -> "pandas.DataFrame":
        """Return the rows of to_numpy as a DataFrame of pandas, which must be installed."""
        import pandas

        return pandas.DataFrame(self._native.table())

    def to_polars(self) -> "polars.DataFrame":
        """Return the rows of to_numpy as a DataFrame of polars, which must be installed."""
        import polars

        return polars.DataFrame(self._native.table(), nan_to_null=True)

    def __repr__(self) -> str:
        return f"<Recording {self._path!r}>"


def read(
    path: Path,
    rig: Optional[Rig] = None,
    *,
    topics: Optional[Mapping[str, str]] = None,
    tolerance_ms: float = 5.0,
    pair: Optional[str] = None,
) -> Recording:
    """Open a recording (MCAP), the folder of a ROS 2 bag, or a folder of images.

    Iterate the result for its frame sets; to_numpy, to_pandas and to_polars give the measurements
    that a run has recorded. ``rig`` is needed unless the recording holds one; a folder never does.
    ``topics`` names the topic with the images of a camera, if it cannot be told from its name.
    ``tolerance_ms`` (0 to 1000) is the largest difference of the stamps within a frame set.
    ``pair`` is the rule by which the files of a folder are of one instant: "name", "order" or
    "time"; default is that of ``trinocular estimate``.

    Warns of files that are not read, and of a recording that was cut off: its end is missing.

    Raises ValueError with file and reason, FileNotFoundError.
    """
    if rig is not None and not isinstance(rig, Rig):
        raise TypeError(f"rig must be a Rig, such as Rig.load(path), not {type(rig).__name__}")
    tolerance_ms = number(tolerance_ms, "tolerance_ms", 0, 1000)
    choice(pair, "pair", "name", "order", "time", None)
    text = existing(path)
    native = None if rig is None else rig._native
    chosen = list((topics or {}).items())
    tolerance_us = round(tolerance_ms * 1e3)
    with words():
        source = _trinocular.Source(text, native, chosen, tolerance_us, pair)
    warn(source.warnings)
    return Recording(source, text)
