"""The tests with the oldest versions that pyproject.toml names, on the oldest Python: `make test-lowest`.

uv chooses the lowest version of every direct dependency and keeps the environment under build/. Further arguments go to
pytest. Tests in real time and in other kernels are left out, for no dependency decides there.
"""

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PLACE = ROOT / "build" / "lowest"
MARKS = "not live and not vcan and not driver"


def main() -> int:
    """Make the environment anew, and run the tests in it; pytest's exit code."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    oldest = project["requires-python"].removeprefix(">=")
    uv = [sys.executable, "-m", "uv"]
    python = PLACE / "bin" / "python"
    shutil.rmtree(PLACE, ignore_errors=True)
    lowest = ("--quiet", "--python", python, "--resolution", "lowest-direct", "--editable", f"{ROOT}[dev]")
    for step in (("venv", "--quiet", "--python", oldest, PLACE), ("pip", "install", *lowest)):
        if code := subprocess.run([*uv, *map(str, step)], cwd=ROOT, check=False).returncode:
            return code
    tests = sys.argv[1:] or ["tests"]
    options = ("-q", "-m", MARKS, "--numprocesses", "auto", "--dist", "loadfile", "-p", "no:cacheprovider")
    return subprocess.run([str(python), "-m", "pytest", *options, *tests], cwd=ROOT, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
