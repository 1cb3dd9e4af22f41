"""Run the tests with other versions of Python and of the dependencies: `make test-lowest` and `make test-newest`.

`lowest` uses the oldest Python that pyproject.toml allows, and the lowest version of every direct dependency; `newest`
uses each of `NEWEST`, and the newest available versions. uv selects them and keeps the environments under build/.
Further arguments go to pytest. Tests in real time and in other kernels are left out, because they do not depend on the
versions.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NEWEST = ("3.12", "3.13")
"""Versions of Python newer than the one that `make test` uses."""
MARKS = "not live and not vcan and not driver"
TESTS = ("-q", "-m", MARKS, "--numprocesses", "auto", "--dist", "loadfile", "-p", "no:cacheprovider")
UV = (sys.executable, "-m", "uv")


def candidates(version: str) -> Iterator[Path]:
    """Return possible paths of a Python of this version, on the PATH and in the folders of pyenv."""
    if named := shutil.which(f"python{version}"):
        yield Path(named)
    versions = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    yield from sorted(versions.glob(f"{version}.*/bin/python"))


def is_version(python: Path, version: str) -> bool:
    """Return whether a Python starts and has this version. A name on the PATH may be a shim without an interpreter."""
    script = "import sys; print('%d.%d' % sys.version_info[:2])"
    answer = subprocess.run([python, "-c", script], capture_output=True, text=True, check=False)
    return answer.stdout.strip() == version


def test_with(version: str, resolution: str, arguments: Sequence[str]) -> int:
    """Recreate an environment, and run the tests in it. Return the exit code of the first failed step, otherwise 0."""
    python = next((path for path in candidates(version) if is_version(path, version)), None)
    if python is None:
        print(
            f"Python {version} is missing: put python{version} on the PATH, or run `pyenv install {version}`"
        )
        return 1
    place = ROOT / "build" / f"{resolution}-{version}"
    shutil.rmtree(place, ignore_errors=True)
    inside = place / "bin" / "python"
    versions = ("--python", inside, "--resolution", resolution, "--editable", f"{ROOT}[dev]")
    steps = (
        (*UV, "venv", "--quiet", "--python", python, place),
        (*UV, "pip", "install", "--quiet", *versions),
        (inside, "-m", "pytest", *TESTS, *(arguments or ["tests"])),
    )
    for step in steps:
        print("──", *step[1:], flush=True)
        if code := subprocess.run([str(word) for word in step], cwd=ROOT, check=False).returncode:
            return code
    return 0


def main() -> int:
    """Run the tests with each version. Return the first exit code that is not 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("which", choices=["lowest", "newest"])
    chosen, arguments = parser.parse_known_args()
    if chosen.which == "lowest":
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        return test_with(project["requires-python"].removeprefix(">="), "lowest-direct", arguments)
    return next(filter(None, [test_with(version, "highest", arguments) for version in NEWEST]), 0)


if __name__ == "__main__":
    sys.exit(main())
