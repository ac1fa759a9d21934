"""The guide and the docstrings run as they are printed."""

import doctest
import importlib
import os
import pkgutil
import re
import shutil
import subprocess
from pathlib import Path

import matplotlib
import pytest
from conftest import DATA, PROGRAM, ROOT, run

import trinocular as t

MODULES = ["trinocular"] + [
    f"trinocular.{module.name}"
    for module in pkgutil.iter_modules(t.__path__)
    if module.name != "_trinocular"
]


def test_docstrings_run():
    results = {name: doctest.testmod(importlib.import_module(name)) for name in MODULES}
    assert [name for name, result in results.items() if result.failed] == []
    assert sum(result.attempted for result in results.values()) > 10


def test_every_name_is_described():
    for name in t.__all__:
        thing = getattr(t, name)
        if isinstance(thing, str):
            continue
        assert len(thing.__doc__) > 30, name
        for member in vars(thing) if isinstance(thing, type) else ():
            if not member.startswith("_") and callable(getattr(thing, member)):
                assert getattr(thing, member).__doc__, f"{name}.{member}"


DOCS = ROOT / "docs"


def page(name):
    return (DOCS / name).read_text(encoding="utf-8")


def run_page(name, folder):
    """Run all blocks of a page in one session, beside the example data."""
    matplotlib.use("Agg")
    shutil.copytree(DATA, folder / "examples" / "data")
    text = page(name)
    session, ran = {"__name__": "__main__"}, 0
    for block in re.finditer(r"^```(python|bash)\n(.*?)^```", text, re.M | re.S):
        language, code = block.groups()
        line = text.count("\n", 0, block.start(2))
        ran += 1
        if language == "bash":
            subprocess.run(["bash", "-euo", "pipefail", "-c", code], check=True)
            continue
        exec(compile("\n" * line + code, f"docs/{name}", "exec"), session)
    return ran


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scripts = os.path.dirname(PROGRAM)
    monkeypatch.setenv("PATH", scripts + os.pathsep + os.environ["PATH"])
    return tmp_path


def test_guide_runs_as_printed(folder):
    assert run_page("python.md", folder) > 5
    assert (folder / "displacement.png").stat().st_size > 1_000


def test_tutorials_run_as_printed(folder):
    assert run_page("tutorials.md", folder) > 5


@pytest.fixture
def recordings(folder):
    """Record twelve runs."""
    (folder / "recordings").mkdir()
    for number, seconds in enumerate(["0.1", "0.2"]):
        words = ["track", "--sim", "--seconds", seconds, "--record", f"recordings/{number}.mcap"]
        assert run(*words).returncode == 0
    for number in range(2, 12):
        shutil.copy(f"recordings/{number % 2}.mcap", f"recordings/{number}.mcap")
    return folder / "recordings"


def test_many_recordings_run_as_printed(folder, recordings):
    assert run_page("many-recordings.md", folder) == 2


def test_unreadable_recording_fails_alone(folder, recordings):
    (code,) = re.findall(r"^```bash\n(.*?)^```", page("many-recordings.md"), re.M | re.S)
    (recordings / "cut.mcap").write_bytes(b"no recording")
    words = ["bash", "-euo", "pipefail", "-c", code]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 123 and "cut.mcap: is no MCAP file" in done.stdout
    results = {path.stem: path.stat().st_size for path in Path("results").glob("*.ndjson")}
    assert len(results) == 13 and [name for name, size in results.items() if not size] == ["cut"]


def test_refused_frames_are_results(folder, recordings):
    (code,) = re.findall(r"^```bash\n(.*?)^```", page("many-recordings.md"), re.M | re.S)
    # A rig whose cameras stand elsewhere fits no frame of the recording.
    fake = folder / "bin" / "trinocular"
    fake.parent.mkdir()
    fake.write_text(f'#!/bin/sh\nexec {PROGRAM} "$@" --rig {folder}/other.toml\n')
    fake.chmod(0o755)
    rig = t.read(recordings / "0.mcap").rig
    fields = rig.to_dict()
    fields["camera"][1]["offset_mm"] = [30.0, 25.0]
    t.Rig.from_dict(fields).save(folder / "other.toml")
    environment = {**os.environ, "PATH": f"{fake.parent}{os.pathsep}{os.environ['PATH']}"}
    words = ["bash", "-euo", "pipefail", "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("frames refused") == 12
