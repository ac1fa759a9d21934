"""The program that the wheel installs."""

import signal
import subprocess

from conftest import PROGRAM, run

import trinocular as t


def test_exit_codes_are_the_programs():
    assert run("--version").stdout.startswith(f"trinocular {t.__version__}")
    assert run("estimate", "no-such", "--rig", "no-such").returncode == 1
    assert run("no-such-command").returncode == 2
    assert run("status", "--port", "/no/such/port").returncode == 1


def test_signal_ends_the_program():
    words = [PROGRAM, "simulate", "tests/scenarios/occlusion.toml"]
    from conftest import ROOT

    process = subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert process.returncode in (-signal.SIGTERM, 143)
