"""A station that follows a target in rendered images."""

import time

import numpy as np
import pytest
from conftest import DATA, interrupted

import trinocular as t

REST = np.array([2.0, -1.5, 3.0])
#: Longest time for which images come, s: a busy computer is slow.
LONGEST_S = 300


def target(time_s):
    """Move for a second, then stand at REST."""
    return min(time_s, 1.0) * REST


def is_there(turn, where=REST, displacement=(0, 0, 0)):
    if not turn:
        return False
    off = np.abs(turn.measurement.displacement_mm - displacement).max()
    return off < 0.04 and np.abs(turn.stage_mm - where).max() < 0.04


def followed(station, frames, where=REST, displacement=(0, 0, 0), **options):
    """Follow until the stage has arrived; return the last turn."""
    for turn in station.follow(frames, **options):
        if is_there(turn, where, displacement):
            return turn
    raise AssertionError(f"the stage did not arrive: {turn}")


def test_stage_follows_to_the_target(rig, scene):
    with t.Station.twin(rig) as station:
        frames = station.simulated_frames(scene, target, frames_per_s=20, seconds=LONGEST_S)
        turn = followed(station, frames)
        measured = turn.measurement
        assert measured.used == len(measured.points) > 50 and turn.latency_ms > 0
        assert (measured.sigma_mm < 0.05).all() and measured.covariance_mm2.shape == (3, 3)
        # It was stopped at the end of the loop.
        status = station.status()
        assert status["state"] == "stopped"
        assert np.abs(np.array(status["position_mm"]) - REST).max() < 0.1
        station.reset()
        station.jog(x=1)


def test_stage_with_other_axes_follows(rig, scene):
    fields = rig.to_dict()
    # The stage's first axis goes down, its second to the left.
    fields["stage"]["matrix"] = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    turned = t.Rig.from_dict(fields)
    x, y, z = REST
    with t.Station.twin(turned) as station:
        frames = station.simulated_frames(scene, target, frames_per_s=20, seconds=LONGEST_S)
        followed(station, frames, where=[y, -x, z])


def test_fixed_cameras_let_the_stage_copy(rig, scene):
    with t.Station.twin(rig, fixed=True) as station:

        def frames():
            for k in range(10_000):
                yield time.monotonic(), scene.render(min(k / 20, 1.0) * REST, seed=k)

        # The displacement is the target's own: the stage cancels none of it.
        followed(station, frames(), displacement=REST)


def test_bad_pictures_move_nothing(rig, scene, before):
    black = np.zeros_like(before)
    with t.Station.twin(rig) as station:
        still = [black, before, black, t.Frame(0, (), "left.png: is no image"), before]
        shots = ((time.monotonic(), images) for images in still)
        found = list(station.follow(shots))
        # The first usable images are the keyframe.
        assert [bool(turn) for turn in found] == [False, False, False, True]
        assert "cannot be the keyframe" in found[0].refused
        assert "left.png" in found[2].refused and found[2].latency_ms is None
        assert np.isnan(found[1].measurement.displacement_mm).all()
        assert [turn.stage_mm.tolist() for turn in found] == [[0, 0, 0]] * 4


def test_end_of_frames_stops_the_stage(rig, before):
    with t.Station.twin(rig) as station:
        shots = ((time.monotonic(), before) for _ in range(3))
        assert len(list(station.follow(shots))) == 2
        assert station.status()["state"] == "stopped"
        station.reset()
        # Without a frame nothing was started, so nothing is stopped.
        assert list(station.follow([])) == []
        assert station.status()["state"] == "idle"


def test_exception_stops_the_stage(rig, before):
    def shots():
        for _ in range(3):
            yield time.monotonic(), before
        raise OSError("the camera is gone")

    with t.Station.twin(rig) as station:
        with pytest.raises(OSError, match="camera is gone"):
            list(station.follow(shots()))
        assert station.status()["state"] == "stopped"
        station.reset()
        endless = ((time.monotonic(), before) for _ in range(10_000))
        with pytest.raises(KeyError):
            for _ in station.follow(endless):
                raise KeyError("mine")
        assert station.status()["state"] == "stopped"


def test_stop_of_another_ends_the_loop(rig, before):
    with t.Station.twin(rig) as station:
        endless = ((time.monotonic(), before) for _ in range(10_000))
        with pytest.raises(t.StationError, match="stopped"):
            for _ in station.follow(endless):
                station.stop()
        assert station.status()["state"] == "stopped"


def test_station_must_be_ready(rig, before):
    with t.Station.twin(rig) as station:
        station.jog(z=1, wait=False)
        station.stop()
        shots = ((time.monotonic(), before) for _ in range(2))
        with pytest.raises(t.StationError, match="refused the frame|stopped"):
            list(station.follow(shots))


@pytest.mark.parametrize(
    "shot, error, words",
    [
        (lambda images: images, TypeError, "pairs"),
        (lambda images: t.Frame(0, tuple(images)), TypeError, "pairs"),
        (lambda images: (time.time() + 1e9, images), ValueError, "in the future"),
        (lambda images: (time.monotonic() - 60, images), ValueError, "ago"),
        (lambda images: (float("nan"), images), ValueError, "time_s"),
        (lambda images: ("now", images), TypeError, "time_s"),
        (lambda images: (time.monotonic(), images[:2]), ValueError, "2 cameras"),
        (lambda images: (time.monotonic(), images / 255), TypeError, "astype"),
    ],
)
def test_wrong_frames_are_refused(rig, before, shot, error, words):
    with t.Station.twin(rig) as station:
        with pytest.raises(error, match=words):
            list(station.follow([shot(before)]))
        assert station.position_mm == [0, 0, 0]


def test_wrong_arguments_are_refused(rig, scene):
    with t.Station.twin(rig) as station:
        with pytest.raises(TypeError, match="iterable"):
            station.follow(3)
        with pytest.raises(ValueError, match="refuse"):
            station.follow([], rotation="maybe")
        with pytest.raises(ValueError, match='give rotation="estimate"'):
            station.follow([], rotation="refuse", pivot_mm=(0, 0, 850))
        with pytest.raises(TypeError, match="Scene"):
            station.simulated_frames(rig, target)
        with pytest.raises(TypeError, match="function"):
            station.simulated_frames(scene, (1, 2, 3))
        with pytest.raises(ValueError, match="0.1 to 1000"):
            station.simulated_frames(scene, target, frames_per_s=0)
    twin = t._trinocular.Twin(rig._native)
    with t.Station(twin.path, heartbeat_ms=10_000) as station:
        with pytest.raises(ValueError, match="takes the rig"):
            station.follow([])
        with pytest.raises(ValueError, match="twin"):
            station.simulated_frames(scene, target)


def test_turning_target_is_followed(rig, scene, before):
    with t.Station.twin(rig) as station:
        shots = ((time.monotonic(), before) for _ in range(3))
        for turn in station.follow(shots, rotation="estimate", pivot_mm=(0, 0, 850)):
            assert turn.measurement.pivot_mm.tolist() == [0, 0, 850]
            assert np.abs(turn.measurement.rotation_deg).max() < 0.1


def test_ctrl_c_stops_the_stage():
    code = f"""
        import trinocular as t
        rig = t.Rig.load({str(DATA / "rig.toml")!r})
        scene = t.Scene(rig)
        with t.Station.twin(rig) as station:
            frames = station.simulated_frames(scene, lambda s: (2 * s % 10, 0, 0), frames_per_s=10)
            try:
                for turn in station.follow(frames):
                    if turn.stage_mm[0] > 0.2:
                        print("working")
            except KeyboardInterrupt:
                print(station.status()["state"])
    """
    code, out, error = interrupted(code, at="working")
    assert code == 0 and out.split()[-1] == "stopped", error
