"""Wrong arguments raise TypeError or ValueError with what, where and the way out."""

import copy
import pickle
import shutil
import warnings

import numpy as np
import pytest
from conftest import DATA, ROOT

import trinocular as t


def test_missing_files_are_named():
    calls = [
        t.Rig.load,
        t.read,
        t.simulate,
        t.Rig.from_opencv,
        lambda path: t.calibrate(path, (9, 6), 25),
        lambda path: t.estimate(path, t.Rig.paper()),
    ]
    for call in calls:
        with pytest.raises(FileNotFoundError, match="no-such"):
            call("no-such")


def test_faults_of_files_have_their_place(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text((DATA / "rig.toml").read_text().replace("538.14", "-538.14"))
    with pytest.raises(ValueError, match=r"rig.toml:\d+: field `camera\[1\].focal_px\[0\]`"):
        t.Rig.load(path)
    for call in (t.Rig.load, t.read, t.simulate):
        with pytest.raises(ValueError):
            call(tmp_path)
    path.write_bytes(b"\xff\x00")
    with pytest.raises(ValueError, match="rig.toml"):
        t.Rig.load(path)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"rotation": "maybe"}, "refuse"),
        ({"method": "best"}, "midpoint"),
        ({"method": "closed-form", "rotation": "estimate"}, "midpoint"),
        ({"rotation": "refuse", "pivot_mm": (0, 0, 850)}, 'pivot_mm: .* give rotation="estimate"'),
        ({"method": "midpoint", "pivot_mm": (0, 0, 850)}, 'give rotation="estimate"'),
        ({"rotation": "refuse", "pivot_mm": "centroid"}, 'give rotation="estimate"'),
        ({"rotation": "estimate", "pivot_mm": "1,2,800"}, "centroid"),
        ({"rotation": "estimate", "pivot_mm": "spot"}, r'pivot_mm="spot": .*\[laser\]'),
        ({"rotation": "estimate", "pivot_mm": (0, np.nan, 850)}, "finite"),
        ({"roi": (0, 0, 10_000, 10)}, "beyond"),
        ({"roi": (-1, 0, 10, 10)}, "beyond"),
        ({"roi": (1.5, 0, 10, 10)}, "whole"),
        ({"roi": (1, 2, 3)}, "width"),
        ({"roi": {"up": (0, 0, 10, 10)}}, "left, middle, right"),
        ({"mask": np.ones((3, 3), bool)}, "shape"),
        ({"mask": np.ones((240, 320), np.uint16)}, "uint8"),
        ({"mask": np.ones((240, 320), np.uint8)}, "largest value is 1"),
        ({"threads": 0}, "1 to 64"),
        ({"threads": 1.5}, "whole"),
        ({"rotation": True}, "refuse"),
        ({"mask": np.ones((240, 320))}, "bool or uint8"),
    ],
)
def test_wrong_options_are_refused(rig, options, words):
    with pytest.raises((ValueError, TypeError), match=words):
        t.Flow(rig, **options)


def test_rig_is_no_path(before):
    with pytest.raises(TypeError, match="Rig.load"):
        t.measure(before, before, "rig.toml")
    with pytest.raises(TypeError, match="Rig.load"):
        t.Rig()


def test_mask_and_regions_restrict_points(rig, before, after):
    mask = np.zeros((240, 320), bool)
    mask[:, :200] = True
    points = t.measure(before, after, rig, mask=mask).points
    assert len(points) > 20 and points["after_px"][:, :, 0].max() < 201
    points = t.measure(before, after, rig, roi={"middle": (40, 30, 200, 150)}).points
    middle = points["before_px"][:, 1]
    assert (middle.min(axis=0) > (39, 29)).all() and (middle.max(axis=0) < (241, 181)).all()


def test_rig_survives_every_copy(rig, tmp_path):
    rig.save(tmp_path / "copy.toml")
    copies = [
        t.Rig.load(tmp_path / "copy.toml"),
        t.Rig.from_dict(rig.to_dict()),
        t.Rig.from_toml(rig.to_toml()),
        pickle.loads(pickle.dumps(rig)),
        copy.copy(rig),
        copy.deepcopy(rig),
    ]
    for one in copies:
        assert one == rig and hash(one) == hash(rig) and one.has_stage
    assert rig != t.Rig.paper() and rig != "rig"
    with pytest.raises(AttributeError):
        rig.names = []
    fields = rig.to_dict()
    fields["camera"][1]["focal_px"] = [-1, 2]
    with pytest.raises(ValueError, match=r"camera\[1\]"):
        t.Rig.from_dict(fields)
    for wrong in ({}, {"camera": None}, {"camera": float("nan")}):
        with pytest.raises(ValueError):
            t.Rig.from_dict(wrong)
    for wrong in ([1], "text", None, {"camera": object()}):
        with pytest.raises(TypeError, match="fields"):
            t.Rig.from_dict(wrong)
    assert t.Rig.from_dict({**rig.to_dict(), "image_size_px": np.array([320, 240])}) == rig
    with pytest.raises(ValueError, match="cannot|no such|No such"):
        rig.save(tmp_path / "none" / "rig.toml")


def test_opencv_files_make_a_rig(rig, tmp_path):
    from conftest import run

    assert run("convert", DATA / "rig.toml", "--opencv", tmp_path / "cv").returncode == 0
    offsets = {"left": (-70, 0), "middle": (0, 0), "right": (68, 0)}
    again = t.Rig.from_opencv(tmp_path / "cv", offsets)
    assert again.to_dict()["camera"] == rig.to_dict()["camera"]
    files = sorted((tmp_path / "cv").iterdir())
    assert t.Rig.from_opencv(files, offsets) == again
    with pytest.raises(ValueError, match="2 to 8"):
        t.Rig.from_opencv(files[0])
    with pytest.raises(ValueError, match="offsets_mm of up: .* left, middle, right"):
        t.Rig.from_opencv(files, {"up": (0, 0)})
    with pytest.raises(ValueError, match="2 to 8"):
        t.Rig.from_opencv([])
    with pytest.raises(ValueError, match="holds no file of a camera"):
        t.Rig.from_opencv(tmp_path)
    bare = tmp_path / "bare"
    bare.mkdir()
    for file in files:
        (bare / file.name).write_text(file.read_text().split("\nR:")[0])
    with pytest.raises(ValueError, match=r'give offsets_mm=\{"left": \(X, Y\)\}'):
        t.Rig.from_opencv(bare)


CAMCHAIN = """\
cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.1, 0.02, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [530.0, 531.0, 319.5, 239.5]
  resolution: [640, 480]
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, {shift}]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.1, 0.02, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [530.0, 531.0, 319.5, 239.5]
  resolution: [640, 480]
"""


def test_camchain_is_read_as_by_convert(tmp_path):
    from conftest import run

    chain, out = tmp_path / "camchain.yaml", tmp_path / "rig.toml"
    chain.write_text(CAMCHAIN.format(shift=-0.07))
    assert run("convert", chain, "--out", out).returncode == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rig = t.Rig.from_opencv(chain)
    assert rig == t.Rig.load(out) and rig.names == ["cam0", "cam1"]
    with pytest.raises(ValueError, match="image_size_px goes with"):
        t.Rig.from_opencv(chain, image_size_px=(640, 480))
    for wrong in (640, "640x480", (640,), (640, 4)):
        with pytest.raises((TypeError, ValueError), match="image_size_px"):
            t.Rig.from_opencv(chain, image_size_px=wrong)


def test_doubts_are_warnings_of_python(rig, tmp_path):
    # As of an offset in metres that was taken for mm.
    chain = tmp_path / "camchain.yaml"
    chain.write_text(CAMCHAIN.format(shift=-0.0003))
    with pytest.warns(UserWarning, match="in metres") as caught:
        small = t.Rig.from_opencv(chain)
    assert caught[0].filename == __file__
    for make in (
        lambda: t.Rig.from_dict(small.to_dict()),
        lambda: t.Rig.from_toml(small.to_toml()),
    ):
        with pytest.warns(UserWarning, match="in metres"):
            assert make() == small
    small.save(tmp_path / "small.toml")
    with pytest.warns(UserWarning, match="in metres"):
        t.Rig.load(tmp_path / "small.toml")
    fields = rig.to_dict()
    fields["stage"]["prediction"] = False
    with pytest.warns(UserWarning, match="prediction is false"):
        unpredicted = t.Rig.from_dict(fields)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pickle.loads(pickle.dumps(unpredicted)) == unpredicted


def test_measurement_is_pickled(rig, before, after):
    measured = t.measure(before, after, rig)
    again = pickle.loads(pickle.dumps(measured))
    assert again.displacement_mm.tolist() == measured.displacement_mm.tolist()
    assert (again.points == measured.points).all()
    with pytest.raises(TypeError, match="pickled"):
        pickle.dumps(t.Flow(rig))


def test_turned_target_names_the_argument(rig, data):
    pixels = np.random.default_rng(2).uniform((-60, -40, 800), (60, 40, 900), (60, 3))
    angle = np.radians(3)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    both = [[rig.project(p), rig.project(turn @ p)] for p in pixels]
    points = np.moveaxis(np.array(both), 1, 2)
    refused = t.estimate(points, rig, rotation="refuse").refused
    assert 'rotation="estimate"' in refused and "--" not in refused
    assert abs(t.estimate(points, rig, rotation="estimate").rotation_deg[2] - 3) < 1e-6


def test_scenario_of_dict_names_the_field():
    scenario = {
        "title": "still",
        "seed": 1,
        "cameras": {"kind": "points", "frames_per_s": 30, "latency_ms": 20, "depth_mm": 850,
                    "points": 100, "noise_px": 0.01},
        "target": [{"motion": "still", "seconds": 0.5}],
        "expect": {},
    }
    run = t.simulate(scenario)
    assert len(run.time_s) >= 500 and np.abs(run.error_mm).max() < 0.1
    with pytest.raises(ValueError, match="depth_mm"):
        t.simulate({**scenario, "cameras": {**scenario["cameras"], "depth_mm": -1}})
    for wrong in ({}, {**scenario, "seed": None}, {**scenario, "seed": float("nan")}):
        with pytest.raises(ValueError):
            t.simulate(wrong)
    with pytest.raises(TypeError):
        t.simulate({**scenario, "seed": object()})
    numpy = {**scenario, "seed": np.int64(1)}
    assert t.simulate(numpy).figures == run.figures


@pytest.mark.parametrize(
    "options",
    [
        {"board": (9,)},
        {"board": "9x6"},
        {"square_mm": "25"},
        {"board": (1, 6)},
        {"square_mm": 0},
        {"square_mm": float("nan")},
        {"outlier": 0.5},
        {"window": 1},
        {"pair": "size"},
        {"images": {}},
        {"images": {"a/b": []}},
        {"images": {"left": [np.zeros((2, 3, 4), np.uint8)]}},
        {"images": {"left": [np.zeros((40, 60), np.uint8)] * 4}},
    ],
)
def test_wrong_calibrations_are_refused(options):
    usual = {"images": {"left": []}, "board": (9, 6), "square_mm": 25}
    with pytest.raises(ValueError) as raised:
        t.calibrate(**{**usual, **options})
    assert "/tmp" not in str(raised.value)


def test_useless_calibrations_are_refused(tmp_path):
    boards = ROOT / "tests" / "images" / "chessboard"
    for name in ("left", "right"):
        shutil.copytree(boards / "left", tmp_path / name)
    with pytest.raises(ValueError, match="`left` and `right` are at the same place"):
        t.calibrate(tmp_path, (9, 6), 25)
    shutil.rmtree(tmp_path / "right")
    doubtful = t.calibrate(tmp_path, (9, 6), 0.025)
    assert any("is square_mm in metres?" in warning for warning in doubtful.warnings)
    assert doubtful.rig is None


@pytest.mark.parametrize("seed", [-1, 1.5, "1", 2**64])
def test_wrong_seeds_are_refused(rig, scene, seed):
    for call in (lambda: t.Scene(rig, seed), lambda: scene.render((0, 0, 0), seed=seed)):
        with pytest.raises((TypeError, ValueError), match="seed"):
            call()


def test_folders_hold_no_measurements(data, rig):
    recording = t.read(data / "captures", rig)
    with pytest.raises(ValueError, match="Flow"):
        recording.to_numpy()
    with pytest.raises(ValueError, match="Rig.load"):
        t.read(data / "captures")
    with pytest.raises(ValueError, match="MCAP"):
        t.read(data / "points.csv")
    # An iteration may be left, and begun again.
    for _ in range(20):
        first = next(iter(recording))
    assert len(list(recording)) == len(list(recording)) > 1 and first.refused is None


def test_unreadable_frames_are_refused(rig, before, after):
    unread = t.Frame(7, (), "left.png: is no image")
    assert "left.png" in t.measure(unread, after, rig).refused
    assert "left.png" in t.measure(before, unread, rig).refused
    assert t.measure(before, unread, rig).time_us == 7
    flow = t.Flow(rig)
    assert flow.keyframe(before) is None
    assert "left.png" in flow.measure(unread).refused
    assert flow.measure(after)
    # An old keyframe must not stand in for one that cannot be read.
    assert flow.keyframe(unread) == "left.png: is no image"
    assert "keyframe cannot be read: left.png" in flow.measure(after).refused
    assert flow.keyframe(before) is None and flow.measure(after)


def test_images_of_another_size_are_refused(data, rig):
    fields = rig.to_dict()
    fields["image_size_px"] = [640, 480]
    other = t.Rig.from_dict(fields)
    flow = t.Flow(other)
    frames = list(t.read(data / "captures", other))
    assert "320 x 240" in flow.keyframe(frames[0])
    assert "320 x 240" in flow.measure(frames[1]).refused
