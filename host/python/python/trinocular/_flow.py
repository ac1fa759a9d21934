"""Measurements from images and from points."""

from __future__ import annotations

from typing import Any, Mapping, Optional, Sequence, Union

import numpy as np
from numpy.typing import NDArray

from . import _trinocular
from ._arrays import Images, Vector, choice, images, vector, whole
from ._measurement import Measurement, measurement
from ._paths import Path, existing
from ._rig import Rig
from ._words import in_python, words

METHODS = ("midpoint", "closed-form", "least-squares")

#: Left, top, width and height, px.
Rectangle = Sequence[int]

#: Point of the target whose displacement is stated: x, y, z in mm, "centroid", or "spot".
Pivot = Union[Vector, str, None]


def _rig(rig: object) -> Rig:
    if not isinstance(rig, Rig):
        raise TypeError(f"rig must be a Rig, such as Rig.load(path), not {type(rig).__name__}")
    return rig


def _per_camera(given: Any, rig: Rig, what: str) -> list[Any]:
    if not isinstance(given, Mapping):
        return [given] * len(rig.names)
    unknown = [name for name in given if name not in rig.names]
    if unknown:
        raise ValueError(f"{what} of {unknown[0]!r}: the rig's cameras are {', '.join(rig.names)}")
    return [given.get(name) for name in rig.names]


def _rectangle(given: Any, rig: Rig) -> Optional[list[int]]:
    if given is None:
        return None
    width, height = rig.image_size_px
    found = np.asarray(given)
    if found.shape != (4,) or found.dtype.kind not in "iu":
        raise ValueError(f"roi {given!r} must be left, top, width, height in whole px")
    x, y, w, h = (int(side) for side in found)
    if min(x, y) < 0 or min(w, h) < 1 or x + w > width or y + h > height:
        raise ValueError(f"roi {given!r} reaches beyond the image of {width} x {height} px")
    return [x, y, w, h]


def _mask(given: Any, rig: Rig) -> Optional[NDArray[Any]]:
    if given is None:
        return None
    width, height = rig.image_size_px
    found = np.asarray(given)
    if found.dtype == bool:
        found = np.where(found, 255, 0).astype(np.uint8)
    if found.dtype != np.uint8 or found.shape != (height, width):
        raise ValueError(
            f"mask is {found.dtype} of the shape {found.shape}; it must be bool or uint8 of the "
            f"shape ({height}, {width}): True or at least 128 where points may be"
        )
    brightest = int(found.max())
    if brightest < 128:
        raise ValueError(
            f"mask hides every point: its largest value is {brightest}, and points may be where it "
            "is True or at least 128"
        )
    return np.ascontiguousarray(found)


def regions_of(
    rig: Rig,
    roi: Union[Rectangle, Mapping[str, Rectangle], None],
    mask: Union[NDArray[Any], Mapping[str, NDArray[Any]], None],
) -> list[tuple[Optional[list[int]], Optional[NDArray[Any]]]]:
    """Return rectangle and mask of each camera."""
    rois = [_rectangle(one, rig) for one in _per_camera(roi, rig, "roi")]
    masks = [_mask(one, rig) for one in _per_camera(mask, rig, "mask")]
    return list(zip(rois, masks))


def pivot_of(pivot_mm: Pivot) -> Union[str, tuple[float, float, float], None]:
    """Return the pivot for the native half."""
    if isinstance(pivot_mm, str):
        choice(pivot_mm, "pivot_mm", "centroid", "spot")
        return pivot_mm
    return None if pivot_mm is None else vector(pivot_mm, "pivot_mm")


class Flow:
    """Tracker of one target: a keyframe, and the measurements against it.

    ``roi`` is a rectangle (left, top, width, height) in px in which points are chosen at the
    keyframe, ``mask`` an array (height, width) that is True (or at least 128) where points may be
    at any time; both for all cameras, or a dict by the camera's name.

    ``rotation`` is "estimate" (refuse images that determine no rotation) or "refuse" (refuse a
    target that turns by more than 0.15 degrees). Default is the rig file's ``rotation``, or the
    rotation where the images determine one and the displacement alone where they do not; with a
    ``method`` and no ``rotation``, none is estimated. A Flow follows any angle about z and tilts of
    up to 40 degrees. ``pivot_mm`` is the point of the target, x, y, z at the keyframe, whose
    displacement is stated, or "centroid", or "spot" for the point that the ray of the rig file's
    ``[laser]`` meets; default is the rig file's ``pivot``, or the centroid. ``method`` is
    "midpoint" (default), "closed-form" or "least-squares". ``threads`` (1 to 64) share the work;
    results do not depend on it.

    One tracker may be used from several threads, which take turns; trackers of their own run in
    parallel. Raises ValueError, TypeError for wrong arguments.
    """

    def __init__(
        self,
        rig: Rig,
        roi: Union[Rectangle, Mapping[str, Rectangle], None] = None,
        *,
        mask: Union[NDArray[Any], Mapping[str, NDArray[Any]], None] = None,
        rotation: Optional[str] = None,
        method: Optional[str] = None,
        pivot_mm: Pivot = None,
        threads: int = 1,
    ) -> None:
        self._rig = _rig(rig)
        choice(rotation, "rotation", "refuse", "estimate", None)
        choice(method, "method", *METHODS, None)
        threads = whole(threads, "threads", 1, 64)
        regions = regions_of(rig, roi, mask)
        pivot = pivot_of(pivot_mm)
        with words():
            self._native = _trinocular.Flow(rig._native, regions, method, rotation, pivot, threads)

    @property
    def rig(self) -> Rig:
        """The rig of the images."""
        return self._rig

    def keyframe(self, images_now: Images) -> Optional[str]:
        """Make these images the reference of all later measurements.

        Takes an array (cameras, height, width) of uint8 or uint16 with any strides, a sequence of
        arrays (height, width) with None for a camera without an image, or a Frame. Returns None, or
        the reason why they cannot be a reference; later measurements are refused with it. The
        ``warnings`` of the next measurement name an image that is badly exposed.
        """
        unread = getattr(images_now, "refused", None)
        if unread is not None:
            self._native.drop_keyframe(f"the keyframe cannot be read: {unread}")
            return str(unread)
        reason = self._native.keyframe(images(images_now, self._rig, "images"))
        return None if reason is None else in_python(reason)

    def measure(self, images_now: Images) -> Measurement:
        """Measure the displacement since the keyframe. Images as for keyframe.

        16-bit values are scaled by the bits that the images have used so far (10, 12, 14 or 16).
        """
        time_us = int(getattr(images_now, "time_us", 0))
        unread = getattr(images_now, "refused", None)
        if unread is not None:
            return Measurement(refused=str(unread), time_us=time_us)
        now = images(images_now, self._rig, "images")
        return measurement(self._native.measure(now, time_us), time_us)

    def __reduce__(self) -> Any:
        raise TypeError("a Flow cannot be pickled; make one in each process: Flow(rig)")


def measure(
    before: Images,
    after: Images,
    rig: Rig,
    roi: Union[Rectangle, Mapping[str, Rectangle], None] = None,
    rotation: Optional[str] = None,
    *,
    mask: Union[NDArray[Any], Mapping[str, NDArray[Any]], None] = None,
    method: Optional[str] = None,
    pivot_mm: Pivot = None,
) -> Measurement:
    """Measure the displacement of the target between two sets of images.

    Arrays (cameras, height, width) of uint8 or uint16 with any strides, or Frames; see Flow for all
    other arguments. For more than two sets of images a Flow is faster: it keeps the reference.

    Never raises for a bad picture: ``refused`` of the result says why there is no displacement.
    Raises TypeError for other types, such as float, and ValueError for a wrong shape.

    >>> from trinocular import Scene
    >>> rig = Rig.paper()
    >>> scene = Scene(rig)
    >>> m = measure(scene.render((0, 0, 0)), scene.render((0, 2, 0)), rig)
    >>> m.refused is None, bool(abs(m.displacement_mm - (0, 2, 0)).max() < 0.1)
    (True, True)
    """
    flow = Flow(rig, roi, mask=mask, rotation=rotation, method=method, pivot_mm=pivot_mm)
    time_us = int(getattr(after, "time_us", 0))
    for name, frame in (("before", before), ("after", after)):
        unread = getattr(frame, "refused", None)
        if unread is not None:
            return Measurement(refused=f"{name} cannot be read: {unread}", time_us=time_us)
    first, now = images(before, rig, "before"), images(after, rig, "after")
    flow._native.keyframe(first)
    return measurement(flow._native.measure(now, time_us), time_us)


def estimate(
    points: Union[NDArray[Any], Path],
    rig: Rig,
    method: Optional[str] = None,
    *,
    rotation: Optional[str] = None,
    pivot_mm: Pivot = None,
) -> Measurement:
    """Estimate the displacement of matched points.

    ``points`` is an array (n, cameras, 2, 2) of floats: x and y in px at the reference instant and
    now, as seen (principal point and distortion not removed), NaN for a camera that has not seen
    the point; or the path of a CSV file ``id,camera,x0,y0,x1,y1``.

    ``method`` is "midpoint" (exact, with standard deviations), "closed-form" or "least-squares"
    (the paper's, for the cameras left, middle, right). Without a method the rotation is estimated
    if the points determine it; ``rotation`` "estimate" demands it, "refuse" refuses points that
    turn by more than 0.15 degrees; default is the rig file's ``rotation``. ``pivot_mm`` as for
    Flow.

    Points that contradict the rig are left out and named in ``warnings``; too few of them make the
    result ``refused``. Raises ValueError with the point and coordinate that is impossible.
    """
    choice(rotation, "rotation", "refuse", "estimate", None)
    choice(method, "method", *METHODS, None)
    pivot = pivot_of(pivot_mm)
    native = _rig(rig)._native
    if isinstance(points, str) or hasattr(points, "__fspath__"):
        path = existing(points)
        with words():
            result = _trinocular.estimate_file(path, native, method, rotation, pivot)
        return measurement(result)
    form = f"(n, {len(rig.names)}, 2, 2): point, camera, before and after, x and y"
    try:
        found = np.asarray(points)
    except ValueError as error:
        raise ValueError(f"points must be an array of numbers {form}: {error}") from None
    if found.dtype.kind not in "iuf":
        raise TypeError(f"points must be an array of numbers {form}, or a path, not {found.dtype}")
    pixels = np.ascontiguousarray(found, dtype=np.float64)
    if pixels.ndim != 4 or pixels.shape[1:] != (len(rig.names), 2, 2):
        raise ValueError(f"points has the shape {pixels.shape}; it must be {form}")
    partly = np.isnan(pixels).any(axis=(2, 3)) & ~np.isnan(pixels).all(axis=(2, 3))
    wrong = partly | np.isinf(pixels).any(axis=(2, 3))
    if wrong.any():
        point, camera = (int(index) for index in np.argwhere(wrong)[0])
        raise ValueError(
            f"points[{point}] of camera {rig.names[camera]}: {pixels[point, camera].tolist()} must "
            "be four finite numbers, or four NaN if the camera has not seen the point"
        )
    unseen = np.isnan(pixels).all(axis=(0, 2, 3))
    if len(pixels) == 0 or unseen.any():
        names = ", ".join(np.array(rig.names)[unseen]) if len(pixels) else "any camera"
        return Measurement(refused=f"no point is seen by {names}")
    with words():
        return measurement(_trinocular.estimate(pixels, native, method, rotation, pivot))
