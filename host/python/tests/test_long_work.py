"""Threads, signals, memory, processes."""

import gc
import multiprocessing
import os
import resource
import threading
import time

import numpy as np
import pytest
from conftest import DATA, interrupted

import trinocular as t


def test_threads_measure_alike(rig, before, after):
    expected = t.measure(before, after, rig).displacement_mm.tolist()
    shared = t.Flow(rig)
    shared.keyframe(before)
    found = []

    def work():
        own = t.Flow(rig)
        own.keyframe(before)
        for flow in (own, shared, own):
            found.append(flow.measure(after).displacement_mm.tolist())

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 24 and all(one == expected for one in found)


def test_lock_is_released_in_long_work(rig):
    ticks, over = [], threading.Event()

    def tick():
        while not over.is_set():
            ticks.append(None)
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    scene = t.Scene(rig)
    images = [scene.render((x, 0, 0), seed=x) for x in range(3)]
    flow = t.Flow(rig)
    thread.start()
    flow.keyframe(images[0])
    for _ in range(20):
        flow.measure(images[1])
    over.set()
    thread.join()
    # With the lock held, the thread would run once per measurement at most.
    assert len(ticks) > 25


def test_ten_thousand_calls_keep_the_memory(rig):
    # Small images: what leaks does so per call.
    fields = rig.to_dict()
    fields["image_size_px"] = [64, 48]
    for camera in fields["camera"]:
        camera["focal_px"] = [107.0, 107.0]
        camera["principal_px"] = [31.5, 23.5]
    small = t.Rig.from_dict(fields)
    scene = t.Scene(small)
    images = [scene.render((x, 0, 0), seed=1 + x) for x in range(2)]
    flow = t.Flow(small)
    flow.keyframe(images[0])

    text = small.to_toml()
    places = np.random.default_rng(1).uniform((-60, -40, 800), (60, 40, 900), (8, 3))
    both = [[small.project(p), small.project(p + (1, 2, 3))] for p in places]
    points = np.moveaxis(np.array(both), 1, 2)
    assert t.estimate(points, small, rotation="refuse")

    def call(times):
        for count in range(times):
            flow.measure(images[1])
            t.estimate(np.empty((0, 3, 2, 2)), small)
            t.estimate(points, small, rotation="refuse")
            t.Rig.from_toml(text)
            # It takes as long as all the others together.
            if count % 10 == 0:
                flow.keyframe(images[0])
            pytest.raises(ValueError, flow.measure, images[1][:2])
        gc.collect()
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    start = call(1_000)
    assert call(9_000) - start < 8 * 1024, "KiB"


@pytest.mark.parametrize(
    "work",
    [
        "t.simulate('tests/scenarios/occlusion.toml')",
        "[t.calibrate('tests/images/chessboard', (9, 6), 25) for _ in range(100)]",
        "[t.measure(a, a, rig) for _ in range(100_000)]",
    ],
)
def test_ctrl_c_ends_work(work):
    code = f"""
        import time
        import trinocular as t
        rig = t.Rig.paper()
        a = t.Scene(rig).render((0, 0, 0))
        print("working")
        start = time.monotonic()
        try:
            {work}
            print("done")
        except KeyboardInterrupt:
            print("interrupted")
        # A second one is the interpreter's business, too.
        try:
            import os, signal
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(10)
        except KeyboardInterrupt:
            print("again")
    """
    code, out, error = interrupted(code, at="working")
    assert (code, out.split()) == (0, ["interrupted", "again"]), error
    assert "panic" not in error


def test_ctrl_c_stops_a_stage():
    code = f"""
        import trinocular as t
        rig = t.Rig.load({str(DATA / "rig.toml")!r})
        with t.Station.twin(rig) as station:
            print("working")
            try:
                station.jog(x=50, wait=True)
                while True:
                    station.jog(x=-50)
                    station.jog(x=50)
            except KeyboardInterrupt:
                print(station.status()["state"])
    """
    code, out, error = interrupted(code, at="working")
    assert (code, out.strip()) == (0, "stopped"), error


def _measured(arguments):
    rig, before, after = arguments
    return t.measure(before, after, rig)


@pytest.mark.parametrize("method", ["spawn", "fork"])
def test_processes_measure_alike(rig, before, after, method):
    expected = t.measure(before, after, rig)
    with multiprocessing.get_context(method).Pool(2) as pool:
        for measured in pool.map(_measured, [(rig, before, after)] * 4):
            assert measured.displacement_mm.tolist() == expected.displacement_mm.tolist()


def test_fork_leaves_the_stage_to_its_parent(rig):
    with t.Station.twin(rig) as station:
        station.jog(x=20, wait=False)
        pid = os.fork()
        if pid == 0:
            try:
                station.stop()
            except ValueError as error:
                del station
                os._exit(0 if "parent" in str(error) else 2)
            os._exit(1)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
        station.wait()
        assert station.position_mm[0] == 20


def test_least_images_are_refused(rig):
    # Of images at the limit of the sizes no interpreter dies, and none gives a number.
    fields = rig.to_dict()
    fields["image_size_px"] = [8, 8]
    for camera in fields["camera"]:
        camera["focal_px"] = [20.0, 20.0]
        camera["principal_px"] = [3.5, 3.5]
    tiny = t.Rig.from_dict(fields)
    image = np.arange(3 * 64, dtype=np.uint8).reshape(3, 8, 8)
    for rotation in ("refuse", "estimate"):
        refused = t.measure(image, image, tiny, rotation=rotation).refused
        assert "corner" in refused, refused
