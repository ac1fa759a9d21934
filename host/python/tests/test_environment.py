"""The script tests/python: its environment is complete, or made again."""

import subprocess

import pytest
from conftest import ROOT

#: A Python whose environments have a pip that fails, and counts, as its folder says.
PYTHON = """\
#!/bin/sh
mkdir -p "$3/bin" && cp "{folder}/pip" "$3/bin/pip"
"""
PIP = """\
#!/bin/sh
echo "$@" >>"{folder}/installed"
! [ -e "{folder}/broken" ]
"""


@pytest.fixture
def script(tmp_path):
    """Return a function that runs the script up to the build of the wheel, which fails."""
    for name, text in [("python", PYTHON), ("pip", PIP), ("cargo", "#!/bin/sh\n")]:
        (tmp_path / name).write_text(text.format(folder=tmp_path))
        (tmp_path / name).chmod(0o755)
    environment = {
        "PATH": f"{tmp_path}:/usr/bin:/bin",
        "PYTHON": str(tmp_path / "python"),
        "CARGO_TARGET_DIR": str(tmp_path / "target"),
    }

    def run():
        words = [ROOT / "tests" / "python"]
        done = subprocess.run(words, env=environment, capture_output=True, text=True)
        assert done.returncode != 0
        return done.stderr

    return run


def test_marker_comes_after_the_installation(script, tmp_path):
    marker, installed = tmp_path / "target" / "python" / "complete", tmp_path / "installed"
    (tmp_path / "broken").touch()
    assert "maturin is missing" not in script() and not marker.exists()
    (tmp_path / "broken").unlink()
    assert "maturin is missing" in script() and "duckdb" in marker.read_text()
    # A complete environment is taken as it is, and one with other packages is not.
    assert "maturin is missing" in script()
    assert len(installed.read_text().splitlines()) == 2
    marker.write_text("pytest\n")
    assert "maturin is missing" in script()
    assert len(installed.read_text().splitlines()) == 3 and "duckdb" in marker.read_text()
    # An installation that is cut off leaves no marker of an earlier one.
    marker.write_text("pytest\n")
    (tmp_path / "broken").touch()
    script()
    assert not marker.exists()
