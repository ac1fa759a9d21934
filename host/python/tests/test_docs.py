"""The guide and the docstrings run as they are printed."""

import doctest
import importlib
import importlib.util
import os
import pkgutil
import re
import shutil
import subprocess

import pytest
from conftest import DATA, PROGRAM, ROOT, run

import trinocular as t

MODULES = ["trinocular"] + [
    f"trinocular.{module.name}"
    for module in pkgutil.iter_modules(t.__path__)
    if module.name != "_trinocular"
]


@pytest.mark.parametrize("name", MODULES)
def test_docstrings_run(name):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


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


def run_page(name, folder):
    """Run all blocks of a page in one session, beside the example data."""
    pytest.importorskip("matplotlib").use("Agg")
    shutil.copytree(DATA, folder / "examples" / "data")
    text = (DOCS / name).read_text(encoding="utf-8")
    session, ran = {"__name__": "__main__"}, 0
    for block in re.finditer(r"^```(python|bash)\n(.*?)^```", text, re.M | re.S):
        language, code = block.groups()
        line = text.count("\n", 0, block.start(2))
        ran += 1
        if language == "bash":
            subprocess.run(["bash", "-euo", "pipefail", "-c", code], check=True)
            continue
        missing = [
            module
            for module in re.findall(r"^import (\w+)", code, re.M)
            if importlib.util.find_spec(module) is None
        ]
        if missing:
            pytest.skip(f"{name}:{line}: {', '.join(missing)} is not installed")
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


def test_many_recordings_run_as_printed(folder):
    (folder / "recordings").mkdir()
    for number, seconds in enumerate(["0.1", "0.2"]):
        words = ["track", "--sim", "--seconds", seconds, "--record", f"recordings/{number}.mcap"]
        assert run(*words).returncode == 0
    for number in range(2, 12):
        shutil.copy(f"recordings/{number % 2}.mcap", f"recordings/{number}.mcap")
    assert run_page("many-recordings.md", folder) == 2
