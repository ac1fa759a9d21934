#!/usr/bin/env python3
"""Compare the speed of the package with that of the program, on the same frames.

    python host/python/benches/speed.py [FRAMES]

Needs the package, as `host/python/build --release` makes it, the program that it installs, and
Valgrind (Debian: valgrind). Prints the tables of README.md: the instructions per frame set, counted
by Valgrind, of the program and of the package on the same folder; the times of the processor, the
least of five rounds in turns; and the times of single calls. Exits with 1 if the package takes over
5 % more instructions per frame set than the program.
"""

import json
import os
import re
import resource
import shutil
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
#: Largest share of the instructions over those of the program.
MOST_OVER = 0.05
COUNT = ["valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null"]

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


def record(frames, folder):
    """Make the images of a simulated run; return the folder and the rig file."""
    recording, images = folder / "run.mcap", folder / "images"
    rig = folder / "rig.toml"
    subprocess.run([PROGRAM, "track", "--sim", "--seconds", str(frames / 60), "--record",
                    recording], check=True, capture_output=True)
    subprocess.run([PROGRAM, "export", recording, "--images", images],
                   check=True, capture_output=True)
    t.read(recording).rig.save(rig)
    return images, rig


def commands(images, rig):
    """Return the commands that measure a folder, of the program and of the package."""
    return ([PROGRAM, "estimate", images, "--rig", rig, "--json"],
            [sys.executable, "-c", LOOP, images, rig])


def instructions(command):
    """Return how many instructions a command takes."""
    done = subprocess.run([*COUNT, *command], capture_output=True, text=True, check=True)
    return int(re.search(r"I +refs: +([0-9,]+)", done.stderr)[1].replace(",", ""))


def counts(images, rig, folder):
    """Print the instructions per frame set; return the package's share over the program."""
    # The start is the same for a third of the frame sets: the difference is without it.
    few = folder / "few"
    for camera in images.iterdir():
        (few / camera.name).mkdir(parents=True)
        files = sorted(camera.iterdir())
        for file in files[:len(files) // 3]:
            shutil.copy(file, few / camera.name)
    sets = len(files) - len(files) // 3
    each = [(instructions(many) - instructions(some)) / sets
            for many, some in zip(commands(images, rig), commands(few, rig))]
    over = each[1] / each[0] - 1
    print("| instructions per frame set | million | over the program |")
    print("|---|---|---|")
    print(f"| `trinocular estimate --json` | {each[0] / 1e6:.2f} |  |")
    print(f"| Python | {each[1] / 1e6:.2f} | {100 * over:+.1f} % |")
    return over


def processes(images, rig):
    theirs, ours = commands(images, rig)
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
    print(f"\n| {len(here)} frame sets from files | wall s | processor s |")
    print("|---|---|---|")
    for words, name in [
        ("`trinocular estimate --json`", "program"),
        ("Python, whole process", "package"),
        ("start of Python and numpy alone", "start of Python"),
    ]:
        (wall_s, cpu_s), above_s = best[name], middle[name][1] - best[name][1]
        print(f"| {words} | {wall_s:.2f} | {cpu_s:.2f} ± {above_s:.2f} |")


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


def main(frames):
    with tempfile.TemporaryDirectory() as folder:
        images, rig = record(frames, Path(folder))
        over = counts(images, rig, Path(folder))
        processes(images, rig)
    calls()
    return over


if __name__ == "__main__":
    if main(int(sys.argv[1]) if len(sys.argv) > 1 else 180) > MOST_OVER:
        sys.exit(f"the package takes over {100 * MOST_OVER:.0f} % more")
