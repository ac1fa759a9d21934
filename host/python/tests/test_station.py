"""The stage of the twin, on a port as a real one."""

import pickle
import threading
import time

import pytest
from conftest import run

import trinocular as t


@pytest.fixture
def station(rig):
    with t.Station.twin(rig) as station:
        yield station


def test_jog_moves_and_zero_counts_from_here(station):
    station.jog(x=1.5, y=-2)
    status = station.status()
    assert status["state"] == "idle" and status["fault"] is None
    assert status["position_mm"] == [1.5, -2.0, 0.0]
    station.zero()
    station.move_to((0.5, 0, 0.25))
    assert station.position_mm == [0.5, 0.0, 0.25]


def test_jog_below_a_step_is_refused(station):
    with pytest.raises(ValueError, match="y=0.006 is less than half a step"):
        station.jog(x=1, y=0.006)
    with pytest.raises(ValueError, match="z=0.0004 is shorter than 0.001 mm"):
        station.jog(x=1, z=0.0004)
    assert station.position_mm == [0, 0, 0]


def test_stop_from_another_thread_ends_a_jog(station):
    timer = threading.Timer(0.2, station.stop)
    timer.start()
    with pytest.raises(t.StationError, match="stopped"):
        station.jog(x=55)
        station.jog(x=-110)
        station.jog(x=110)
    timer.join()
    assert station.status()["state"] == "stopped"
    with pytest.raises(t.StationError, match="refused jog"):
        station.jog(x=1)
    station.reset()
    before = station.position_mm[0]
    station.jog(y=1)
    assert station.position_mm[:2] == [before, 1.0]


def test_jog_without_wait_returns_at_once(station):
    station.jog(z=30, wait=False)
    assert station.status()["state"] == "moving"
    with pytest.raises(t.StationError, match="moves|moving|rest"):
        station.jog(x=1)
    station.wait()
    assert station.position_mm[2] == 30


def test_position_beyond_soft_limits_is_refused(station):
    before = station.position_mm
    with pytest.raises(ValueError, match=r"y = -300 mm .* travel_mm"):
        station.move_to((10, -300, 0))
    assert tuple(station.position_mm) == tuple(before)


def test_soft_limit_shortens(station):
    station.jog(x=500)
    assert station.position_mm[0] == 60


@pytest.mark.parametrize("wrong", [5000, float("nan"), float("inf"), "far", None, (1, 2)])
def test_impossible_distances_are_refused(station, wrong):
    with pytest.raises((ValueError, TypeError)):
        station.jog(x=wrong)
    with pytest.raises((ValueError, TypeError)):
        station.move_to((0, wrong, 0) if wrong != 5000 else (1e9, 0, 0))
    assert station.position_mm == [0, 0, 0]


def test_closed_station_says_so(rig):
    station = t.Station.twin(rig)
    station.close()
    station.close()
    for call in (station.status, station.stop, station.zero, station.jog):
        with pytest.raises(ValueError, match="closed"):
            call()
    with pytest.raises(TypeError, match="pickled"):
        pickle.dumps(station)


def test_end_of_block_stops_the_stage(rig):
    with pytest.raises(RuntimeError, match="mine"), t.Station.twin(rig) as station:
        twin = station._twin
        station.jog(x=50, wait=False)
        raise RuntimeError("mine")
    with t.Station(twin.path) as other:
        assert other.status()["state"] == "stopped"
        assert 0 <= other.status()["position_steps"][0] < 50 * 80


def test_others_are_served_while_one_waits(station):
    waiting = threading.Thread(target=station.jog, args=(50,))
    waiting.start()
    while station.status()["state"] != "moving":
        time.sleep(0.01)
    # The jog does not hold the line.
    with pytest.raises(t.StationError, match="refused reset: the stage is moving"):
        station.reset()
    asked = 0
    while station.status()["state"] == "moving":
        asked += 1
    waiting.join()
    assert asked > 3 and station.position_mm[0] == 50


def test_station_without_configuration_says_so(rig):
    # As after a restart.
    twin = t._trinocular.Twin(rig._native)
    with t.Station(twin.path, heartbeat_ms=10_000) as station:
        assert station.status()["state"] == "unconfigured"
        with pytest.raises(t.StationError, match=r"refused jog: .*rig=Rig.load\(path\)"):
            station.jog(x=1)
        with pytest.raises(t.StationError, match=r"refused to wait: .*rig=Rig.load\(path\)"):
            station.wait()


def test_wrong_ports_are_named(rig):
    with pytest.raises(t.StationError, match="/no/such/port"):
        t.Station("/no/such/port")
    with pytest.raises(TypeError):
        t.Station(3)
    with pytest.raises(ValueError, match="stage"):
        t.Station.twin(t.Rig.paper())
    with pytest.raises(ValueError, match="20 to 10000"):
        t.Station("auto", heartbeat_ms=1)


def test_program_shares_the_twin(station):
    # The station is reached by its port, as by any program.
    seen = run("status", "--port", station.status()["port"], "--json")
    assert '"state":"idle"' in seen.stdout.replace(" ", ""), seen.stderr
