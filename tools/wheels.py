"""Build the wheels of hil-bridge and of the packages in packages/ and examples/, install them into a new environment,
and run them.

This step of the check mostly waits for downloads. All wheels share one environment, which does not use the
checkout.
"""

import hashlib
import json
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = sorted(path.parent for path in ROOT.glob("examples/*/pyproject.toml"))
"""Example packages, written as a third-party author would write them."""
PACKAGES = [*EXAMPLES, *sorted(path.parent for path in ROOT.glob("packages/*/pyproject.toml"))]
TOYS = ("--robot", "toyarm", "--sensor", "toyload", "--surface", "toyspring", "--controller", "pi-tracking")
STEADY_N = 10.0, 0.5
"""Force that a run must reach, and its tolerance, N."""


class CleanEnvironment:
    """New environment outside the checkout, with the commands that run in it."""

    def __init__(self, place: Path, python: str = sys.executable) -> None:
        self.place = place
        run_command(place, python, "-m", "venv", place / "env")
        self._scripts = place / "env" / Path(sys.executable).parent.name

    def run(self, name: str, *arguments: str | Path) -> str:
        """Return the output of a command of the environment. Raises RuntimeError if it fails."""
        return run_command(self.place, self._scripts / name, *arguments)

    def install(self, *wheels: str | Path) -> None:
        """Install wheels with all their dependencies. It uses uv, which caches packages."""
        python = self._scripts / "python"
        run_command(
            self.place, sys.executable, "-m", "uv", "pip", "install", "--quiet", "--python", python, *wheels
        )

    def closes_the_loop(self, name: str, *options: str | Path) -> Path:
        """Run, and return the recording of the run. Raises RuntimeError if the run does not reach its force."""
        record, summary = self.place / f"{name}.mcap", self.place / f"{name}.json"
        self.run(
            "hil-bridge",
            "run",
            *options,
            "--no-view",
            "--record",
            record,
            "--summary",
            summary,
            "--overwrite",
        )
        force = json.loads(summary.read_text(encoding="utf-8"))["force_mean_steady_n"]
        if abs(force - STEADY_N[0]) > STEADY_N[1]:
            raise RuntimeError(f"{name} came to {force} N")
        return record


def run_command(place: Path, *command: str | Path) -> str:
    """Return the output of a command in a folder. Raises RuntimeError if it fails."""
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    if done.returncode:
        result = f"{done.stdout}{done.stderr}"
        raise RuntimeError(f"{' '.join(map(str, command))} ended with exit code {done.returncode}\n{result}")
    return done.stdout


def install_wheels(elsewhere: CleanEnvironment) -> None:
    """Build all wheels with one call of pip, and install them with another."""
    folder = elsewhere.place / "wheels"
    elsewhere.install("hatchling>=1.28")  # shared by all builds, instead of one copy for each
    build = ("-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", folder)
    elsewhere.run("python", *build, ROOT, *PACKAGES)
    wheels = sorted(folder.glob("*.whl"))
    if len(wheels) != 1 + len(PACKAGES):
        raise RuntimeError(f"hil-bridge and {len(PACKAGES)} packages made {len(wheels)} wheels")
    (own,) = (wheel for wheel in wheels if wheel.name.startswith("hil_bridge-"))
    wheels.remove(own)
    check_same(elsewhere, own)
    elsewhere.install(f"{own}[testing]", *wheels)  # ours is first, because the others depend on it


def check_same(elsewhere: CleanEnvironment, wheel: Path) -> None:
    """Check that a second build of our wheel has identical bytes, and that its list of parts has the right hashes."""
    again = elsewhere.place / "again"
    elsewhere.run(
        "python", "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", again, ROOT
    )
    if (again / wheel.name).read_bytes() != wheel.read_bytes():
        raise RuntimeError("two builds of the same sources differ")
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (one for one in archive.namelist() if one.endswith(".dist-info/sboms/hil-bridge.cdx.json"))
        result = json.loads(archive.read(name))
        for file in result["components"][0]["components"]:
            (path,) = (one for one in archive.namelist() if one.endswith(f"/vendor/{file['name']}"))
            if hashlib.sha256(archive.read(path)).hexdigest() != file["hashes"][0]["content"]:
                raise RuntimeError(f"the list of parts has another hash of {path}")


def run_alone(elsewhere: CleanEnvironment) -> None:
    """Run the command by itself, with the default cell."""
    elsewhere.run("hil-bridge", "--version")
    summary = elsewhere.place / "s.json"
    elsewhere.run("hil-bridge", "run", "--virtual", "--duration", "5", "--no-view", "--summary", summary)
    if not summary.stat().st_size:
        raise RuntimeError("the short run wrote an empty summary")


def offered() -> set[str]:
    """Return the names of the plug-ins that the packages define."""
    files = (tomllib.loads((package / "pyproject.toml").read_text(encoding="utf-8")) for package in PACKAGES)
    groups = (group for file in files for group in file["project"].get("entry-points", {}).items())
    return {name for group, names in groups if group.startswith("hil_bridge.") for name in names}


def run_examples(elsewhere: CleanEnvironment) -> None:
    """Run the toy devices by name, in virtual and in real time. The tests run all other surfaces."""
    result = json.loads(elsewhere.run("hil-bridge", "list", "plugins", "--json"))
    wrong = [row["told"] for row in result if row["state"] != "ok"]
    if wrong or {row["name"] for row in result} != offered():
        raise RuntimeError(f"plugins lists {result}")
    for name, time_of in (("virtual", ("--virtual",)), ("real", ())):
        record = elsewhere.closes_the_loop(name, *TOYS, "--duration", "3", *time_of)
        elsewhere.run("hil-bridge", "latency", record)
        elsewhere.run("hil-bridge", "replay", record)
    elsewhere.run("hil-bridge", "report", record, "--output", record.with_suffix(""))


def test_examples(elsewhere: CleanEnvironment) -> None:
    """Run the examples' own tests. They are copied out of the checkout, so that pytest uses their own settings."""
    tests = elsewhere.place / "tests"
    tests.mkdir()
    for example in EXAMPLES:
        for file in (example / "tests").glob("*.py"):  # also the clients that tests start
            (tests / file.name).write_bytes(file.read_bytes())
    (tests / "pytest.ini").write_text("[pytest]\naddopts = --import-mode=importlib\n", encoding="utf-8")
    print(elsewhere.run("pytest", "-q", "-p", "no:cacheprovider", tests).strip().splitlines()[-1])
    for example in EXAMPLES:
        elsewhere.run("pytest", "--collect-only", "-q", "-p", "no:cacheprovider", example / "tests")


STEPS: tuple[Callable[[CleanEnvironment], None], ...] = (
    install_wheels,
    run_alone,
    run_examples,
    test_examples,
)


def check_wheels() -> int:
    """Perform all steps. Return 0, or 1 after printing the output if a step fails."""
    with tempfile.TemporaryDirectory(prefix="hil-bridge-wheel-") as name:
        try:
            elsewhere = CleanEnvironment(Path(name))
            for step in STEPS:
                began = time.monotonic()
                step(elsewhere)
                print(f"{step.__name__}: {time.monotonic() - began:.0f} s", flush=True)
        except (RuntimeError, OSError, ValueError) as error:
            print(error)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(check_wheels())
