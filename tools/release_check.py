"""Steps that a release has to pass in addition to the check: `make release-check`.

The wheel is built from the source distribution, twine checks both, and the wheel is installed into a clean
environment with the oldest Python that pyproject.toml allows. In this environment it has to run a cell, replay the
recording and report it. The size of the installation and the time of an import are printed. `tools/exercised.py`
uses the evidence of the tests and of the guard's campaign to check that every part of the guard was exercised.
"""

import re
import shutil
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

from wheels import ROOT, CleanEnvironment, run_command

SIZE_LIMIT_MB = 250.0
"""Maximum size of the core with all its dependencies, MB."""
HEAVY = "import sys, hil_bridge as h; h.simulate({'run': {'duration_s': 1.0}}); print('matplotlib' in sys.modules)"
CELL = ("--virtual", "--duration", "3", "--no-view")


class Release:
    """Built distributions, and the environment in which they are tested."""

    def __init__(self, place: Path) -> None:
        self.place = place
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        self.version: str = project["version"]
        self.oldest: str = project["requires-python"].removeprefix(">=")
        python = shutil.which(f"python{self.oldest}")
        if python is None:
            raise RuntimeError(f"no python{self.oldest} on the path, the oldest that pyproject.toml names")
        (place / "core").mkdir()
        self.core = CleanEnvironment(place / "core", python)

    @property
    def wheel(self) -> Path:
        """Wheel of this version."""
        (wheel,) = (self.place / "dist").glob("*.whl")
        return wheel


def build(release: Release) -> str:
    """Build the source distribution, and the wheel from it, as uploaded to a package index."""
    dist = release.place / "dist"
    run_command(release.place, sys.executable, "-m", "build", "--outdir", dist, ROOT)
    (release.place / "twine").mkdir()
    judge = CleanEnvironment(release.place / "twine")
    judge.install("twine")
    judge.run("twine", "check", "--strict", *sorted(dist.iterdir()))
    with ZipFile(release.wheel) as archive:
        names = archive.namelist()
    strange = {name.split("/")[0] for name in names} - {"hil_bridge", "emulators", "protocol"}
    if strange != {f"hil_bridge-{release.version}.dist-info"}:
        raise RuntimeError(f"the wheel holds {sorted(strange)}")
    for required in (
        "hil_bridge/py.typed",
        "emulators/py.typed",
        "protocol/py.typed",
        "licenses/LICENSE",
        "show/pages/vendor/uPlot.iife.js",
        "show/pages/vendor/uPlot.min.css",
        "show/pages/uPlot-LICENSE.txt",
    ):
        if not any(name.endswith(required) for name in names):
            raise RuntimeError(f"the wheel has no {required}")
    return ", ".join(f"{path.name} {path.stat().st_size / 1e6:.2f} MB" for path in sorted(dist.iterdir()))


def check_exercised(release: Release) -> str:
    """Check that every part of the guard was exercised by a test, the campaign, or a separate run."""
    text = run_command(ROOT, sys.executable, "-m", "tools.exercised", "--strike")
    return "; ".join(line for line in text.splitlines() if line and not line.startswith(" "))


def check_change_log(release: Release) -> str:
    """Check that the change log begins with this version, and that this version is not a development version."""
    if ".dev" in release.version:
        raise RuntimeError(
            f"pyproject.toml has {release.version}, a development version; name the release there"
        )
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    first = re.search(r"^## (\S+)", text, re.MULTILINE)
    if first is None or first[1] != release.version:
        raise RuntimeError(
            f"CHANGELOG.md begins with {first and first[1]}, pyproject.toml has {release.version}"
        )
    return f"CHANGELOG.md tells of {release.version}"


def check_oldest_python(release: Release) -> str:
    """Check the wheel with the oldest Python: a new configuration runs, and its recording can be replayed."""
    core = release.core
    core.install(release.wheel)
    if release.version not in core.run("hil-bridge", "--version"):
        raise RuntimeError("the wheel has another version")
    config, record = core.place / "cell.toml", core.place / "run.mcap"
    core.run("hil-bridge", "config", "init", config)
    core.run("hil-bridge", "run", config, *CELL, "--record", record)
    core.run("hil-bridge", "replay", record)
    core.run("hil-bridge", "report", record, "--output", core.place / "report")
    return "a configuration runs, its recording is replayed and reported"


def check_installation(release: Release) -> str:
    """Check a clean installation of the core: its size without pip, and the modules that a run imports."""
    (release.place / "clean").mkdir()
    clean = CleanEnvironment(release.place / "clean")
    clean.install(release.wheel)
    clean.run("python", "-m", "pip", "uninstall", "--quiet", "--yes", "setuptools", "pip")
    size = sum(path.stat().st_size for path in clean.place.rglob("*") if path.is_file()) / 1e6
    if size > SIZE_LIMIT_MB:
        raise RuntimeError(f"the core takes {size:.0f} MB; allowed: at most {SIZE_LIMIT_MB:g}")
    if clean.run("python", "-c", HEAVY).strip() != "False":
        raise RuntimeError("a run imports matplotlib")
    begun = time.monotonic()
    clean.run("python", "-c", "import hil_bridge; hil_bridge.simulate")
    return f"{size:.0f} MB; import of the interface {time.monotonic() - begun:.2f} s with Python's own start"


STEPS: tuple[Callable[[Release], str], ...] = (
    check_change_log,
    check_exercised,
    build,
    check_oldest_python,
    check_installation,
)


def main() -> int:
    """Perform all steps; return 1 if one fails."""
    with tempfile.TemporaryDirectory(prefix="hil-bridge-release-") as name:
        try:
            release = Release(Path(name))
            for step in STEPS:
                print(f"{step.__name__}: ", end="", flush=True)
                print(step(release), flush=True)
        except (RuntimeError, OSError, ValueError) as error:
            print(error)
            return 1
    print(f"{release.version} may be released")
    return 0


if __name__ == "__main__":
    sys.exit(main())
