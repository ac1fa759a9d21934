"""What the tests share: example data of the repository, the installed program, a rendered scene."""

import functools
import json
import os
import signal
import subprocess
import sys
import sysconfig
import textwrap
import time
from pathlib import Path

import pytest

import trinocular as t

ROOT = Path(__file__).resolve().parents[3]
DATA = ROOT / "examples" / "data"
PROGRAM = os.path.join(sysconfig.get_path("scripts"), "trinocular")


def run(*arguments, **options):
    """Run the installed program."""
    words = [PROGRAM, *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, timeout=300, **options)


def interrupted(code, *, at):
    """Start Python code, wait for the word `at`, send Ctrl-C; return code and error."""
    words = [sys.executable, "-u", "-c", textwrap.dedent(code)]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    # A shell that starts tests in the background lets them ignore Ctrl-C, and so their children.
    heed = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    process = subprocess.Popen(words, **options, cwd=ROOT, preexec_fn=heed)
    assert process.stdout.readline().strip() == at
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    out, error = process.communicate(timeout=60)
    return process.returncode, out, error


def rows(*arguments):
    """Return the JSON objects that the program prints."""
    return [json.loads(line) for line in run(*arguments).stdout.splitlines()]


def printed(value, key="", outer="either"):
    """Return an object with its numbers rounded as the program prints them."""
    if isinstance(value, dict):
        return {name: printed(one, name, digits(name, outer)) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [printed(one, key, outer) for one in value]
    if not isinstance(value, float):
        return value
    fine = outer == "three" or outer == "either" and 0 < abs(value) < 1e-3
    return float(f"{value:.2e}" if fine else f"{value:.6f}") + 0.0


def digits(key, outer):
    if any(word in key for word in ("sigma", "deviation", "covariance")):
        return "three"
    units = ("_mm", "_px", "_deg", "_ms", "_s", "_mm_s", "_mm_s2", "_percent")
    if key.endswith(units):
        return "six"
    return "three" if outer == "three" else "either"


@pytest.fixture(scope="session")
def data():
    return DATA


@pytest.fixture(scope="session")
def rig():
    return t.Rig.load(DATA / "rig.toml")


@pytest.fixture(scope="session")
def scene(rig):
    return t.Scene(rig)


@pytest.fixture(scope="session")
def before(scene):
    return scene.render((0, 0, 0), seed=1)


@pytest.fixture(scope="session")
def after(scene):
    return scene.render((4, -2, 5), seed=2)


def pytest_terminal_summary(terminalreporter):
    """Count the tests as cargo does, for the summary of `tests/run`."""
    count = {kind: len(terminalreporter.stats.get(kind, [])) for kind in ("passed", "skipped")}
    failed = sum(len(terminalreporter.stats.get(kind, [])) for kind in ("failed", "error"))
    terminalreporter.write_line(
        f"test result: {count['passed']} passed; {failed} failed; {count['skipped']} ignored"
    )
