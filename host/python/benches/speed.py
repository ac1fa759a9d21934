#!/usr/bin/env python3
"""Compare the speed of the package with that of the program, on the same frames.

    python host/python/benches/speed.py [FRAMES]

Needs the package, as `host/python/build --release` makes it, and the program that it installs.
Both measure the same folder, in turns; the least time of five counts, and the tolerance is how far
the median lies above it. Prints the tables of README.md. Exits with 1 if the package takes over 5 %
more of the processor than the program, by more than the tolerance.
"""

import json
import os
import resource
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path

import numpy as np

import trinocular as t

PROGRAM = os.path.join(sysconfig.get_path("scripts"), "trinocular")
ROUNDS = 5
#: Largest share of the processor's time over that of the program.
MOST_OVER = 0.05

LOOP = """
import json, sys
import trinocular as t
rig = t.Rig.load(sys.argv[2])
flow = t.Flow(rig)
frames = iter(t.read(sys.argv[1], rig))
flow.keyframe(next(frames))
print(json.dumps([flow.measure(frame).displacement_mm.tolist() for frame in frames]))
"""


def used(command):
    """Run a command; return its wall time, the processor's time, and its output."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    wall_s = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall_s, cpu_s, done.stdout


def least(call, count):
    """Return the least time of the processor for a call, µs, over five rounds of `count`."""
    best = float("inf")
    for _ in range(ROUNDS):
        start = time.process_time()
        for _ in range(count):
            call()
        best = min(best, (time.process_time() - start) / count)
    return 1e6 * best


def processes(frames):
    with tempfile.TemporaryDirectory() as folder:
        recording, images = Path(folder) / "run.mcap", Path(folder) / "images"
        rig = Path(folder) / "rig.toml"
        seconds = str(frames / 60)
        subprocess.run([PROGRAM, "track", "--sim", "--seconds", seconds, "--record", recording],
                       check=True, capture_output=True)
        subprocess.run([PROGRAM, "export", recording, "--images", images],
                       check=True, capture_output=True)
        t.read(recording).rig.save(rig)
        ours = [sys.executable, "-c", LOOP, images, rig]
        theirs = [PROGRAM, "estimate", images, "--rig", rig, "--json"]
        nothing = [sys.executable, "-c", "import trinocular"]
        times = {"program": [], "package": [], "start of Python": []}
        for _ in range(ROUNDS):
            program, package = used(theirs), used(ours)
            times["program"].append(program[:2])
            times["package"].append(package[:2])
            times["start of Python"].append(used(nothing)[:2])
            there = [json.loads(line) for line in program[2].splitlines()]
            here = json.loads(package[2])
            assert len(here) == len(there)
            for mm, row in zip(here, there):
                assert "refused" in row or np.allclose(
                    mm, row["displacement_mm"], rtol=0, atol=5.01e-7)  # six decimals
    best = {name: np.min(rows, axis=0) for name, rows in times.items()}
    middle = {name: np.median(rows, axis=0) for name, rows in times.items()}
    apart = {name: middle[name][1] - best[name][1] for name in times}
    program = best["program"][1]
    loop = best["package"] - best["start of Python"]
    apart["loop"] = apart["package"] + apart["start of Python"]
    over = loop[1] / program - 1
    tolerance = (apart["loop"] + apart["program"]) / program
    print(f"| {len(here)} frame sets from files | wall s | processor s | over the program |")
    print("|---|---|---|---|")
    for name, (wall_s, cpu_s), apart_s, share in [
        ("`trinocular estimate --json`", best["program"], apart["program"], ""),
        ("Python, whole process", best["package"], apart["package"], ""),
        ("start of Python and numpy alone", best["start of Python"], apart["start of Python"], ""),
        ("Python without its start", loop, apart["loop"],
         f"{100 * over:+.1f} % ± {100 * tolerance:.1f} %"),
    ]:
        print(f"| {name} | {wall_s:.2f} | {cpu_s:.2f} ± {apart_s:.2f} | {share} |")
    return over - tolerance <= MOST_OVER


def calls():
    rig = t.Rig.paper()
    scene = t.Scene(rig)
    before, after = scene.render((0, 0, 0)), scene.render((4, 2, 1), seed=2)
    flow = t.Flow(rig)
    flow.keyframe(before)
    native = [np.ascontiguousarray(image) for image in after]
    whole = least(lambda: flow.measure(after), 100)
    print("\n| call, 3 x 320 x 240 px | µs |")
    print("|---|---|")
    print(f"| `flow.measure`, uint8 | {whole:.0f} |")
    print(f"| the same without the checks and data classes of the package | "
          f"{least(lambda: flow._native.measure(native, 0), 100):.0f} |")
    mirrored = after[:, ::-1].copy()[:, ::-1]
    print(f"| `flow.measure`, reversed rows | {least(lambda: flow.measure(mirrored), 100):.0f} |")
    deep = after.astype(np.uint16) * 16
    print(f"| `flow.measure`, uint16 | {least(lambda: flow.measure(deep), 100):.0f} |")
    both = least(lambda: t.measure(before, after, rig), 20)
    print(f"| `measure(before, after, rig)` | {both:.0f} |")


if __name__ == "__main__":
    is_within = processes(int(sys.argv[1]) if len(sys.argv) > 1 else 600)
    calls()
    sys.exit(0 if is_within else f"the package takes over {100 * MOST_OVER:.0f} % more")
