"""Types, strides and byte orders of images and points."""

import numpy as np
import pytest

import trinocular as t


def same(a, b):
    assert a.refused is None and b.refused is None
    assert a.displacement_mm.tolist() == b.displacement_mm.tolist()
    assert a.sigma_mm.tolist() == b.sigma_mm.tolist()


@pytest.fixture(scope="module")
def expected(rig, before, after):
    measured = t.measure(before, after, rig)
    assert measured.refused is None
    assert np.abs(measured.displacement_mm - (4, -2, 5)).max() < 0.1
    return measured


def read_only(array):
    array = array.copy()
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    "form",
    [
        np.asfortranarray,
        read_only,
        lambda a: a[:, ::-1, ::-1].copy()[:, ::-1, ::-1],
        lambda a: np.repeat(a, 2, axis=2)[:, :, ::2],
        lambda a: np.moveaxis(np.ascontiguousarray(np.moveaxis(a, 0, -1)), -1, 0),
        lambda a: list(a),
        memoryview,
        lambda a: tuple(a),
        lambda a: a.tolist(),
        lambda a: a.view(np.ndarray).astype(np.uint16) * 16,
        lambda a: (a.astype(np.uint16) * 257).astype(">u2"),
        lambda a: (a.astype(np.uint16) * 4).astype("<u2"),
    ],
)
def test_any_layout_gives_same_bits(rig, before, after, expected, form):
    same(t.measure(form(before), form(after), rig), expected)


def test_arguments_stay_as_they_were(rig, before, after):
    copies = before.copy(), after.copy()
    t.measure(before, after, rig)
    assert (before == copies[0]).all() and (after == copies[1]).all()


@pytest.mark.parametrize(
    "kind, words",
    [
        (np.float32, "astype"),
        (np.float64, "full scale"),
        (np.int16, "uint8 or uint16"),
        (np.int64, "uint8 or uint16"),
        (bool, "uint8 or uint16"),
        (np.uint32, "uint8 or uint16"),
        (complex, "uint8 or uint16"),
        (object, "uint8 or uint16"),
    ],
)
def test_other_types_are_refused_in_words(rig, before, after, kind, words):
    with pytest.raises(TypeError, match=words) as raised:
        t.measure(before, after.astype(kind), rig)
    assert "after" in str(raised.value)


@pytest.mark.parametrize(
    "wrong, words",
    [
        (lambda a: a[0], "shape"),
        (lambda a: a[:2], "2 cameras"),
        (lambda a: a[None], "shape"),
        (lambda a: a[:, :-1], "height, width"),
        (lambda a: np.swapaxes(a, 1, 2), "swapaxes"),
        (lambda a: np.moveaxis(a, 0, -1), "moveaxis"),
        (lambda a: np.stack([a] * 3, axis=-1), "shape"),
        (lambda a: [np.stack([b] * 3, axis=-1) for b in a], "colour"),
        (lambda a: a[:, :0], "height, width"),
        (lambda a: np.empty((0, 0, 0), np.uint8), "0 cameras"),
        (lambda a: [None, None, None], "no camera"),
        (lambda a: [[[1, 2], [3]]] * 3, "numbers|shape"),
        (lambda a: [[[-1, 2], [3, 4]]] * 3, "0 to 65535"),
    ],
)
def test_other_shapes_are_refused_in_words(rig, before, after, wrong, words):
    with pytest.raises(ValueError, match=words):
        t.measure(before, wrong(after), rig)
    with pytest.raises(ValueError, match="before"):
        t.measure(wrong(before), after, rig)


@pytest.mark.parametrize("nonsense", [None, 1, "image.png", b"bytes", {1, 2}, object(), iter([])])
def test_no_images_are_refused(rig, before, nonsense):
    with pytest.raises((TypeError, ValueError)):
        t.measure(before, nonsense, rig)


def test_masked_arrays_are_refused(rig, before, after):
    with pytest.raises(TypeError, match="mask="):
        t.measure(before, [np.ma.masked_array(one) for one in after], rig)


def test_missing_camera_is_left_out(rig, before, after):
    measured = t.measure(before, [after[0], None, after[2]], rig)
    assert measured.refused is None
    assert np.abs(measured.displacement_mm - (4, -2, 5)).max() < 0.2
    assert "middle" in measured.warnings[0]
    assert np.isnan(measured.points["after_px"][:, 1]).all()


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_bad_picture_is_no_exception(rig, before, after, grey):
    blank = np.full_like(before, grey)
    for pair in [(blank, after), (before, blank), (blank, blank)]:
        measured = t.measure(*pair, rig)
        assert measured.refused and not measured
        assert np.isnan(measured.displacement_mm).all() and len(measured.points) == 0


def test_noise_is_refused(rig, before):
    noise = np.random.default_rng(1).integers(0, 256, before.shape, dtype=np.uint8)
    assert t.measure(before, noise, rig).refused
    assert "lost" in t.measure(before, noise, rig).refused


def test_points_are_where_they_move(rig, expected):
    points = expected.points
    assert len(points) == expected.used > 100
    assert points["before_px"].shape == (len(points), 3, 2)
    place = points["place_mm"][0]
    assert 800 < place[2] < 900
    seen = np.array(rig.project(place))
    assert np.abs(seen - points["before_px"][0]).max() < 0.5
    moved = np.array(rig.project(place + expected.displacement_mm))
    assert np.abs(moved - points["after_px"][0]).max() < 0.5


@pytest.fixture(scope="module")
def pixels(rig):
    places = np.random.default_rng(1).uniform((-60, -40, 800), (60, 40, 900), (40, 3))
    moved = places + (1, 2, 3)
    both = [[rig.project(p), rig.project(q)] for p, q in zip(places, moved)]
    return np.moveaxis(np.array(both), 1, 2)


def test_points_of_arrays_are_exact(rig, pixels):
    measured = t.estimate(pixels, rig)
    assert np.abs(measured.displacement_mm - (1, 2, 3)).max() < 1e-6
    for form in (np.asfortranarray, lambda a: a.tolist(), lambda a: a[::-1][::-1], read_only):
        same(t.estimate(form(pixels), rig), measured)
    same(t.estimate(pixels.astype(">f8"), rig), measured)
    assert t.estimate(pixels.astype(np.float32), rig).refused is None


def test_unseen_points_are_left_out(rig, pixels):
    some = pixels.copy()
    some[3, 1] = np.nan
    measured = t.estimate(some, rig)
    assert measured.rejected == 1 and measured.refused is None
    for unseen in (pixels[:0], np.full_like(pixels, np.nan)):
        assert "no point" in t.estimate(unseen, rig).refused
    some[:, 1] = np.nan
    assert "middle" in t.estimate(some, rig).refused


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e9])
def test_impossible_points_are_named(rig, pixels, wrong):
    some = pixels.copy()
    some[3, 1, 1, 0] = wrong
    with pytest.raises(ValueError, match=r"points\[3\]|points:"):
        t.estimate(some, rig)


@pytest.mark.parametrize("shape", [(3,), (40, 2, 2, 2), (40, 3, 4), (0,), (2, 40, 3, 2)])
def test_points_of_other_shapes_are_refused(rig, shape):
    with pytest.raises(ValueError, match="point, camera"):
        t.estimate(np.zeros(shape), rig)
    with pytest.raises(TypeError):
        t.estimate([["a"]], rig)
    with pytest.raises(TypeError, match="complex"):
        t.estimate(np.zeros((5, 3, 2, 2), complex), rig)
