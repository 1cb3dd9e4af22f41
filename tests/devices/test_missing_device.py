"""The core without one of its devices: everything else works, and the rest names the missing package."""

import json
import os
import shutil
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest

from hil_bridge.devices.kinds import ROBOTS

pytestmark = pytest.mark.full

ROOT = Path(__file__).resolve().parents[2]
PARENTS = (
    "protocol/devices",
    "emulators/devices",
    "hil_bridge/devices/robots",
    "hil_bridge/devices/sensors",
    "hil_bridge/device_commands",
)
RUN = ("run", "--virtual", "--no-view", "--duration", "0.4")
CASES = {
    "s3": ("--robot", "s3", "--sensor", "netft"),
    "egm": ("--robot", "egm", "--sensor", "netft"),
    "rsi": ("--robot", "rsi", "--sensor", "netft"),
    "rtde": ("--robot", "rtde", "--sensor", "netft"),
    "jr3": ("--robot", "s3", "--sensor", "jr3"),
    "netft": ("--robot", "s3", "--sensor", "netft"),
    "ft300": ("--robot", "s3", "--sensor", "ft300"),
    "ati_can": ("--robot", "s3", "--sensor", "ati-can"),
}
"""Cell that needs the device, by the folder of the device."""
CHILD = """
import json, sys
from click.testing import CliRunner
from hil_bridge.cli import cli
answers = []
for line in json.loads(sys.argv[1]):
    done = CliRunner().invoke(cli, line, standalone_mode=False)
    error = done.exception
    answers.append("" if error is None or getattr(error, "code", 1) == 0 else f"{type(error).__name__}: {error}")
print(json.dumps(answers))
"""


def copy_without(device: str, tree: Path) -> None:
    """Copy the packages to a tree, without the folders and the entry points of a device."""
    for package in ("protocol", "emulators", "hil_bridge"):
        shutil.copytree(ROOT / package, tree / package)
    for parent in PARENTS:
        shutil.rmtree(tree / parent / device, ignore_errors=True)
    metadata = tree / "hil_bridge-0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: hil-bridge\nVersion: 0\n")
    points = distribution("hil-bridge").read_text("entry_points.txt") or ""
    left = [line for line in points.splitlines() if f".{device}." not in line]
    (metadata / "entry_points.txt").write_text("\n".join(left))


def run_commands(tree: Path, *commands: tuple[str, ...]) -> list[str]:
    """Return the error of each command of the packages in a tree, "" where there is none."""
    process = subprocess.run(
        [sys.executable, "-c", CHILD, json.dumps(commands)],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree)},
        capture_output=True,
        text=True,
        check=True,
    )
    answers: list[str] = json.loads(process.stdout.splitlines()[-1])
    return answers


@pytest.mark.parametrize("device", CASES)
def test_core_without_device_opens_its_recording(device: str, tmp_path: Path) -> None:
    recordings = [str(tmp_path / name) for name in ("run.mcap", "again.mcap")]
    needs = (*RUN, *CASES[device])
    assert run_commands(ROOT, (*needs, "--record", recordings[0])) == [""]
    shutil.copy(*recordings)
    tree = tmp_path / "tree"
    copy_without(device, tree)
    other = (
        "--robot",
        "egm" if device == "s3" else "s3",
        "--sensor",
        "jr3" if device == "netft" else "netft",
    )
    *errors, lacking = run_commands(
        tree,
        ("--help",),
        ("config", "init", str(tmp_path / "cell.toml")),
        (*RUN, *other, "--no-record"),
        ("why", recordings[0]),
        ("report", recordings[0], "-o", str(tmp_path / "report")),
        ("compare", *recordings, "-o", str(tmp_path / "compare.html")),
        ("export", recordings[0], "--to", "bytes,csv", "-o", str(tmp_path / "export")),
        ("latency", recordings[0]),
        ("monitor", recordings[0]),
        needs,
    )
    assert errors == [""] * len(errors)
    assert f"there is no {'robot' if device in ROBOTS.names else 'sensor'} " in lacking
