"""Campaign on workers of a Dask scheduler, each in a separate process: the same rows as on one machine, even if a
worker is killed.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from hil_bridge.errors import BridgeError
from hil_bridge.lab.campaign.plan_file import read_plan
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.working import missing, work

pytestmark = [pytest.mark.skipif(os.name != "posix", reason="SIGKILL"), pytest.mark.full]

ROOT = Path(__file__).parents[2]
DASK = "distributed==2026.8.0"
STUDY = """
[campaign]
name = "study"
seeds = { from = 1, to = 8 }
[campaign.matrix]
task.force_n = [8.0, 10.0]
[[campaign.fault]]
on = "robot"
fault = "emergency-stop"
phase = "track"
[campaign.criteria]
outcome = "completed"
[config.run]
duration_s = 0.3
[config.sensor]
emulated = "ft300"
[config.task]
retract_mm = 2.0
[config.cell]
start_position_mm = [900.0, -100.0, 591.0]
"""


class Dask:
    """Programs of Dask, run in an environment that contains it and also reads this project."""

    def __init__(self, python: Path, folder: Path) -> None:
        self._python, self._folder = python, folder
        self._contact = folder / "scheduler.json"

    def start(self, *arguments: str, path: Path = ROOT) -> "subprocess.Popen[bytes]":
        """Start `dask scheduler` or `dask worker`; `path` is the location of the project that it reads."""
        rest = ["--scheduler-file", str(self._contact), "--host", "127.0.0.1", "--no-dashboard"]
        return subprocess.Popen(
            [self._python, "-m", "dask", *arguments, *rest],
            env=self.environment(path),
            cwd=self._folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def campaign(self, *arguments: str) -> "subprocess.Popen[str]":
        """Run `hil-bridge campaign` in the same environment."""
        return subprocess.Popen(
            [self._python, "-m", "hil_bridge", "campaign", *arguments],
            env=self.environment(ROOT),
            cwd=self._folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def environment(self, path: Path) -> dict[str, str]:
        """Return variables of the environment: this project and its dependencies come from where the test runs."""
        return os.environ | {"PYTHONPATH": os.pathsep.join((str(path), sysconfig.get_path("purelib")))}

    def url(self) -> str:
        """URL of the scheduler, once it has printed it."""
        until("the scheduler listens", lambda: self._contact.exists() and self._contact.stat().st_size > 0)
        return str(json.loads(self._contact.read_text())["address"])


def until(what: str, holds: Callable[[], bool], seconds: float = 90.0) -> None:
    """Wait for something that other processes do."""
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline, f"not in {seconds:g} s: {what}"
        time.sleep(0.05)


@contextmanager
def ended(process: "subprocess.Popen[bytes]") -> Iterator["subprocess.Popen[bytes]"]:
    """Yield the process, and end it after the test."""
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def dask(client_python: Callable[..., Path], tmp_path: Path) -> Dask:
    return Dask(client_python(DASK), tmp_path)


def rows(place: Path) -> dict[str, object]:
    """Return the stored results of each run, by its key."""
    try:
        with Store.open(place) as store:
            return {
                one.key: (one.number, one.seed, one.outcome, one.failed, one.figures) for one in store.runs()
            }
    except BridgeError:
        return {}


@pytest.mark.timeout(240)
def test_killed_worker_loses_no_rows(dask: Dask, tmp_path: Path) -> None:
    study = tmp_path / "study.toml"
    study.write_text(STUDY)
    with ExitStack() as stack:
        stack.enter_context(ended(dask.start("scheduler", "--port", "0")))
        url = dask.url()
        first, _ = [
            stack.enter_context(ended(dask.start("worker", "--nthreads", "1", "--no-nanny")))
            for _ in range(2)
        ]
        far = tmp_path / "far.sqlite"
        process = dask.campaign(str(study), "--scheduler", url, "--output", str(far))
        until("a chunk is kept", lambda: len(rows(far)) > 0 or process.poll() is not None)
        assert process.poll() is None, process.communicate()[0]
        first.send_signal(signal.SIGKILL)
        assert 0 < len(rows(far)) < 32
        output, _ = process.communicate(timeout=120)
        assert process.returncode == 4, output  # an emergency stop does not meet `completed`
    plan = read_plan(study)
    with Store.begin(tmp_path / "near.sqlite", plan) as store:
        work(plan, store, missing(plan, store), workers=1)
    assert len(rows(far)) == 32
    assert rows(far) == rows(tmp_path / "near.sqlite")
    with Store.open(far) as store:
        assert all((store.folder / run.recording).is_file() for run in store.runs("passed = 0"))
        assert len(list(store.folder.iterdir())) == 16


@pytest.mark.timeout(120)
def test_worker_with_other_code_is_refused(dask: Dask, tmp_path: Path) -> None:
    study, other = tmp_path / "study.toml", tmp_path / "other"
    study.write_text(STUDY)
    other.mkdir()
    for package in ("hil_bridge", "emulators"):
        (other / package).symlink_to(ROOT / package)
    shutil.copytree(ROOT / "protocol", other / "protocol", ignore=shutil.ignore_patterns("__pycache__"))
    (other / "protocol" / "newer.py").write_text("# a line more\n")
    with ended(dask.start("scheduler", "--port", "0")):
        url = dask.url()
        with ended(dask.start("worker", "--nthreads", "1", "--no-nanny", path=other)):
            process = dask.campaign(str(study), "--scheduler", url)
            output, _ = process.communicate(timeout=90)
    assert process.returncode == 3, output
    reported = [line for line in output.splitlines() if line.startswith("hil-bridge: ")]
    assert len(reported) == 1, output
    assert "a worker has hil-bridge" in reported[0]
    assert "Traceback" not in output
    assert rows(tmp_path / "study.sqlite") == {}


def test_missing_package_or_scheduler_is_reported(tmp_path: Path) -> None:
    study = tmp_path / "study.toml"
    study.write_text(STUDY)
    process = subprocess.run(
        [sys.executable, "-m", "hil_bridge", "campaign", str(study), "--scheduler", "tcp://127.0.0.1:1"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert process.returncode == 2
    assert len(process.stderr.splitlines()) == 1
    assert "needs the package distributed" in process.stderr or "no scheduler answers" in process.stderr
