"""Steps that a release has to pass beside the check: `make release-check`.

The wheel is made from the source distribution, both are judged by twine, and the wheel goes into a clean environment of
the oldest Python that pyproject.toml names, where it has to run a cell, replay it and report it. The size of the
installation and the time of an import are told. Evidence of the tests and of the guard's campaign must show that
nothing of the guard is left unexercised, by `tools/exercised.py`.
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

from wheels import ROOT, Elsewhere, ran

SIZE_LIMIT_MB = 250.0
"""Most that the core may take with all that it depends on."""
HEAVY = "import sys, hil_bridge as h; h.simulate({'run': {'duration_s': 1.0}}); print('matplotlib' in sys.modules)"
CELL = ("--virtual", "--duration", "3", "--no-view")


class Release:
    """The build, and the environment that it is tried in."""

    def __init__(self, place: Path) -> None:
        self.place = place
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        self.version: str = project["version"]
        self.oldest: str = project["requires-python"].removeprefix(">=")
        python = shutil.which(f"python{self.oldest}")
        if python is None:
            raise RuntimeError(f"no python{self.oldest} on the path, the oldest that pyproject.toml names")
        (place / "core").mkdir()
        self.core = Elsewhere(place / "core", python)

    @property
    def wheel(self) -> Path:
        """The wheel of this version."""
        (wheel,) = (self.place / "dist").glob("*.whl")
        return wheel


def built(release: Release) -> str:
    """Source distribution, and the wheel from it; both as an index would take them."""
    dist = release.place / "dist"
    ran(release.place, sys.executable, "-m", "build", "--outdir", dist, ROOT)
    (release.place / "twine").mkdir()
    judge = Elsewhere(release.place / "twine")
    judge.install("twine")
    judge.run("twine", "check", "--strict", *sorted(dist.iterdir()))
    with ZipFile(release.wheel) as archive:
        names = archive.namelist()
    strange = {name.split("/")[0] for name in names} - {"hil_bridge", "emulators", "protocol"}
    if strange != {f"hil_bridge-{release.version}.dist-info"}:
        raise RuntimeError(f"the wheel holds {sorted(strange)}")
    for wanted in (
        "hil_bridge/py.typed",
        "emulators/py.typed",
        "protocol/py.typed",
        "licenses/LICENSE",
        "show/pages/vendor/uPlot.iife.js",
        "show/pages/vendor/uPlot.min.css",
        "show/pages/uPlot-LICENSE.txt",
    ):
        if not any(name.endswith(wanted) for name in names):
            raise RuntimeError(f"the wheel has no {wanted}")
    return ", ".join(f"{path.name} {path.stat().st_size / 1e6:.2f} MB" for path in sorted(dist.iterdir()))


def exercised(release: Release) -> str:
    """Nothing of the guard is left that no test, no seed of its campaign and no run of its own has struck."""
    told = ran(ROOT, sys.executable, "-m", "tools.exercised", "--strike")
    return "; ".join(line for line in told.splitlines() if line and not line.startswith(" "))


def told_changes(release: Release) -> str:
    """Check that the change log begins with this version, and that it is no development version."""
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


def serves(release: Release) -> str:
    """Check the wheel in an environment of the oldest Python: a new configuration runs, its recording is replayed."""
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


def light(release: Release) -> str:
    """Check a clean installation of the core: its size without pip, and what a run imports."""
    (release.place / "clean").mkdir()
    clean = Elsewhere(release.place / "clean")
    clean.install(release.wheel)
    clean.run("python", "-m", "pip", "uninstall", "--quiet", "--yes", "setuptools", "pip")
    size = sum(path.stat().st_size for path in clean.place.rglob("*") if path.is_file()) / 1e6
    if size > SIZE_LIMIT_MB:
        raise RuntimeError(f"the core takes {size:.0f} MB, allowed are {SIZE_LIMIT_MB:g}")
    if clean.run("python", "-c", HEAVY).strip() != "False":
        raise RuntimeError("a run imports matplotlib")
    begun = time.monotonic()
    clean.run("python", "-c", "import hil_bridge; hil_bridge.simulate")
    return f"{size:.0f} MB; import of the interface {time.monotonic() - begun:.2f} s with Python's own start"


STEPS: tuple[Callable[[Release], str], ...] = (told_changes, exercised, built, serves, light)


def main() -> int:
    """Take all steps; 1 when one fails."""
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
