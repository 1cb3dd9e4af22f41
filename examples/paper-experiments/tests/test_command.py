"""End-to-end tests of the command `hil-bridge experiment`."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from paper_experiments import EXPERIMENTS
from paper_experiments.command import experiment

from hil_bridge.errors import ConfigError


def run(*arguments):
    return CliRunner().invoke(experiment, [str(argument) for argument in arguments])


def test_rules_and_simulation_leave_their_files(tmp_path):
    page = tmp_path / "p.md"
    arguments = ("rules", "fig3-5", "--output", tmp_path, "--seeds", 1, "--workers", 1, "--page", page)
    assert run(*arguments).exit_code == 0
    curves = {"fig3-5.png", "fig3-5.csv", "fig3-5-curves.csv"}
    assert {path.name for path in tmp_path.iterdir()} == {"p.md", "rules.csv", *curves}


def test_same_seeds_give_the_same_files(tmp_path):
    for folder in ("a", "b"):
        run("fig3-5", "--output", tmp_path / folder, "--seeds", 2, "--workers", 1)
    for path in {*(tmp_path / "a").iterdir()} - {tmp_path / "a" / "index.md"}:  # which names its folder
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def test_unknown_names_are_answered_with_the_known_ones(tmp_path):
    result = run("fig4", "--output", tmp_path)
    assert isinstance(result.exception, ConfigError)
    assert result.exception.exit_code == 2
    assert all(name in str(result.exception) for name in (*EXPERIMENTS, "all", "fig4"))


@pytest.mark.parametrize("option", ["--output", "--page"])
def test_unwritable_places_are_refused_in_one_line_before_any_work(tmp_path, option):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    result = run("controllers", "--output", tmp_path, option, blocked / "below")
    assert isinstance(result.exception, ConfigError)
    assert result.exception.exit_code == 2
    assert len(str(result.exception).splitlines()) == 1
    assert str(blocked) in str(result.exception)


def children_of(pid: int) -> list[int]:
    """Return the living child processes of a process."""
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    except FileNotFoundError:
        return []


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux for the workers")
def test_sigterm_ends_the_command_with_its_workers(tmp_path):
    command = [
        sys.executable,
        "-m",
        "hil_bridge",
        "experiment",
        "fig9-11",
        "--workers",
        "2",
        "--output",
        tmp_path,
    ]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            ends = time.monotonic() + 60.0
            while (
                len(workers := children_of(process.pid)) < 3
            ):  # two, and the one that looks after their semaphores
                assert process.poll() is None
                assert time.monotonic() < ends
                time.sleep(0.05)
            process.terminate()
            assert process.wait(timeout=30.0) == 128 + signal.SIGTERM
        finally:
            process.kill()
    ends = time.monotonic() + 30.0
    while any(Path(f"/proc/{worker}").exists() for worker in workers):
        assert time.monotonic() < ends, "workers are left behind"
        time.sleep(0.05)
