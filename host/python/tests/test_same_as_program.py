"""Numbers are equal to those of the program, in every digit that it prints."""

import csv
import json

import cv2
import matplotlib.image
import numpy as np
import pandas
import pytest
from conftest import ROOT, printed, rows, run

import trinocular as t


def drop(line):
    """Return an object without the version of the format."""
    return {key: value for key, value in line.items() if key != "version"}


def check(measured, row):
    if "refused" in row:
        assert measured.refused is not None
        # The arguments are named as in Python.
        assert measured.refused.split(";")[0] == row["refused"].split(";")[0]
        return
    assert measured.refused is None, measured.refused
    numbers = {
        "displacement_mm": measured.displacement_mm.tolist(),
        "sigma_mm": measured.sigma_mm.tolist(),
        "covariance_mm2": measured.covariance_mm2.tolist(),
        "rotation_deg": measured.rotation_deg.tolist(),
        "rotation_sigma_deg": measured.rotation_sigma_deg.tolist(),
        "pivot_mm": measured.pivot_mm.tolist(),
    }
    for name, value in printed(numbers).items():
        if row.get(name) is None:
            assert np.isnan(value).all(), name
        else:
            assert value == row[name], name
    assert (measured.used, measured.rejected) == (row["points"], row["rejected"])
    assert len(measured.warnings) == len(row.get("warnings", []))


@pytest.mark.parametrize("rotation", ["refuse", "estimate"])
def test_folder_measures_as_estimate(data, rig, rotation):
    options = ["--rig", data / "rig.toml", "--rotation", rotation, "--json"]
    expected = rows("estimate", data / "captures", *options)
    frames = list(t.read(data / "captures", rig))
    flow = t.Flow(rig, rotation=rotation)
    assert flow.keyframe(frames[0]) is None
    measured = [flow.measure(frame) for frame in frames[1:]]
    assert len(measured) == len(expected) > 0
    for one, row in zip(measured, expected):
        check(one, row)
    # The function for two frame sets gives the same.
    check(t.measure(frames[0], frames[1], rig, rotation=rotation), expected[0])


def test_regions_measure_as_roi(data, rig):
    options = ["--rig", data / "rig.toml", "--roi", "middle=40,30,200,150", "--json"]
    expected = rows("estimate", data / "captures", *options)
    frames = list(t.read(data / "captures", rig))
    flow = t.Flow(rig, roi={"middle": (40, 30, 200, 150)})
    flow.keyframe(frames[0])
    for frame, row in zip(frames[1:], expected):
        check(flow.measure(frame), row)


@pytest.fixture
def captures(scene, tmp_path):
    """Return a folder of frame sets whose keyframe is overexposed in the middle."""
    for name in ("left", "middle", "right"):
        (tmp_path / "captures" / name).mkdir(parents=True)
    for k in range(3):
        images = scene.render((0.5 * k, 0, 0), seed=k + 1)
        if k == 0:
            images[1, :8] = 255
        for name, image in zip(("left", "middle", "right"), images):
            assert cv2.imwrite(str(tmp_path / "captures" / name / f"{k}.png"), image)
    return tmp_path / "captures"


def test_exposure_of_keyframe_is_named(captures, data, rig):
    expected = rows("estimate", captures, "--rig", data / "rig.toml", "--json")
    assert "camera middle" in expected[0]["warnings"][0] and "warnings" not in expected[1]
    frames = list(t.read(captures, rig))
    flow = t.Flow(rig)
    flow.keyframe(frames[0])
    measured = [flow.measure(frame) for frame in frames[1:]]
    assert [list(one.warnings) for one in measured] == [expected[0]["warnings"], []]
    assert list(t.measure(frames[0], frames[1], rig).warnings) == expected[0]["warnings"]


@pytest.mark.parametrize("pivot", ["centroid", "spot", [-12.5, 8.0, 850.0]])
def test_rotation_of_rig_file_is_heeded(captures, data, tmp_path, pivot):
    text = (data / "rig.toml").read_text()
    turning = tmp_path / "turning.toml"
    laser = "[laser]\nfrom_mm = [0, 40, 0]\ndirection = [0, -0.05, 1]\n"
    turning.write_text(f'rotation = "estimate"\npivot = {json.dumps(pivot)}\n{text}\n{laser}')
    rig = t.Rig.load(turning)
    frames = list(t.read(captures, rig))
    for options in ({}, {"rotation": "refuse"}, {"pivot_mm": "centroid"}):
        words = []
        for name, value in options.items():
            words += ["--pivot" if name == "pivot_mm" else f"--{name}", value]
        expected = rows("estimate", captures, "--rig", turning, "--json", *words)
        assert ("rotation_deg" in expected[0]) == ("rotation" not in options)
        flow = t.Flow(rig, **options)
        flow.keyframe(frames[0])
        for frame, row in zip(frames[1:], expected):
            check(flow.measure(frame), row)
        check(t.measure(frames[0], frames[1], rig, **options), expected[0])
        points = ["estimate", data / "points.csv", "--rig", turning, "--json", *words]
        check(t.estimate(data / "points.csv", rig, **options), rows(*points)[0])
    closed = ["--rig", turning, "--json", "--method", "closed-form"]
    (row,) = rows("estimate", data / "points.csv", *closed)
    check(t.estimate(data / "points.csv", rig, "closed-form"), row)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"method": "midpoint"},
        {"method": "closed-form"},
        {"method": "least-squares"},
        {"rotation": "estimate"},
        {"rotation": "refuse"},
        {"pivot_mm": (-12.5, 8, 850)},
    ],
)
def test_points_estimate_as_estimate(data, rig, options):
    words = []
    for name, value in options.items():
        text = value if isinstance(value, str) else ",".join(map(str, value))
        words += ["--pivot" if name == "pivot_mm" else f"--{name}", text]
    command = ["estimate", data / "points.csv", "--rig", data / "rig.toml", "--json", *words]
    (row,) = rows(*command)
    from_file = t.estimate(data / "points.csv", rig, **options)
    check(from_file, row)
    # Arrays take the same way.
    options_of_numpy = {"delimiter": ",", "names": True, "dtype": None, "encoding": "utf-8"}
    table = np.genfromtxt(data / "points.csv", **options_of_numpy)
    ids = list(dict.fromkeys(table["id"].tolist()))
    pixels = np.full((len(ids), 3, 2, 2), np.nan)
    for point in table:
        place = (ids.index(point["id"]), rig.names.index(point["camera"]))
        pixels[place] = [[point["x0"], point["y0"]], [point["x1"], point["y1"]]]
    check(t.estimate(pixels, rig, **options), row)


@pytest.mark.parametrize("name", ["step", "line"])
def test_scenario_runs_as_simulate(name):
    path = ROOT / "tests" / "scenarios" / f"{name}.toml"
    (row,) = rows("simulate", path, "--points", "--json")
    run_here = t.simulate(path, points=True)
    assert list(run_here.missed) == row["missed"]
    for figure, value in printed(run_here.figures).items():
        assert value == row[figure], figure
    assert run_here.error_mm.shape == (len(run_here.time_s), 3)


def test_recording_reads_as_export(tmp_path):
    path, table = tmp_path / "run.mcap", tmp_path / "run.csv"
    assert run("track", "--sim", "--seconds", 1, "--record", path).returncode == 0
    assert run("export", path, "--csv", table).returncode == 0
    recording = t.read(path)
    rows_here = recording.to_numpy()
    with open(table, newline="", encoding="utf-8") as file:
        rows_there = list(csv.DictReader(file))
    assert list(rows_here.dtype.names) == list(rows_there[0])
    assert len(rows_here) == len(rows_there) > 10
    for here, there in zip(rows_here, rows_there):
        for name, cell in there.items():
            if isinstance(here[name], np.str_):
                assert here[name] == cell, name
            else:
                number = float(cell) if cell else np.nan
                np.testing.assert_equal(float(here[name]), number, err_msg=name)
    frame = recording.to_pandas()
    assert isinstance(frame, pandas.DataFrame) and frame["x_mm"].iloc[-1] == rows_here["x_mm"][-1]
    frame = recording.to_polars()
    assert frame["x_mm"][-1] == rows_here["x_mm"][-1] and frame["x_mm"].null_count() > 0
    assert len(list(recording)) > 10


def test_recorded_images_measure_as_estimate(data, rig, tmp_path):
    path = tmp_path / "run.mcap"
    command = ["track", "--images", data / "captures", "--rig", data / "rig.toml", "--record", path]
    assert run(*command).returncode == 0
    expected = rows("estimate", path, "--json")
    recording = t.read(path)
    assert recording.rig == rig
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: -path.stat().st_size // 100])
    with pytest.warns(UserWarning, match="is cut off at byte"):
        t.read(cut)
    frames = list(recording)
    assert frames[1].time_us > frames[0].time_us
    flow = t.Flow(recording.rig)
    flow.keyframe(frames[0])
    assert len(expected) == len(frames) - 1 > 0
    for frame, row in zip(frames[1:], expected):
        check(flow.measure(frame), row)


def test_calibration_equals_calibrate(tmp_path):
    boards = ROOT / "tests" / "images" / "chessboard"
    command = ["calibrate", boards, "--board", "9x6", "--square", "25"]
    out = tmp_path / "rig.toml"
    output = run(*command, "--json", "--out", out).stdout
    objects = [json.loads(line) for line in output.splitlines()]
    result = t.calibrate(boards, (9, 6), 25)
    assert printed(result.cameras) == [drop(one) for one in objects if "rig" not in one]
    places = [one["rig"] for one in objects if "rig" in one]
    assert printed({"rig": result.places}) == {"rig": places[0]}
    assert result.rig == t.Rig.load(out)
    # Arrays are calibrated as files are.
    cameras = {
        name: [matplotlib.image.imread(file) for file in sorted((boards / name).iterdir())]
        for name in ("left", "right")
    }
    assert cameras["left"][0].dtype == np.uint8
    again = t.calibrate(cameras, (9, 6), 25)
    assert np.allclose(again.cameras[0]["focal_px"], result.cameras[0]["focal_px"], rtol=1e-3)
