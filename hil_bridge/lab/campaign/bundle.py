"""Bundle: the results of a campaign in one zip file, with everything that another computer needs to verify them.

It contains `results.sqlite` with the configuration of every case; the data files named by settings, such as a policy;
recordings of failed runs and of sampled seeds; and `manifest.json`, with the versions and the SHA-256 of each file.
"""

import hashlib
import io
import platform
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec
from msgspec import Struct

from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.digest import worst_first
from hil_bridge.lab.campaign.inputs import computing_packages, hash_file, pack_inputs
from hil_bridge.lab.campaign.plan import Plan, code_version
from hil_bridge.lab.campaign.repeating import RepeatedRun, repeat_of, repeat_runs
from hil_bridge.lab.campaign.store import Done, Store, now
from hil_bridge.record.files import check_place, write_atomically

MANIFEST, RESULTS, RECORDINGS = "manifest.json", "results.sqlite", "recordings"
FILES_MOST = 2000
"""Maximum number of files in a bundle. Chosen: more recordings than anyone inspects."""
UNPACKED_LIMIT_BYTES = 1 << 30
"""Largest total size of the unpacked files of a bundle, and largest size of the bundle itself, bytes. Chosen: a
thousand recordings of 1 MB.
"""
FORMAT = "hil-bridge bundle 3"
"""Format identifier of the bundle."""
PACKAGES = ("numpy",)
"""Third-party packages whose arithmetic affects a run."""
_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time stamp of every file in a bundle, so that two bundles of the same files differ only in the manifest."""

MISSING = "none"
"""Version text of a package that is not installed."""

Advance = Callable[[int, int], object]
"""Progress callback. It receives the number of runs repeated since the last call, and the number of these runs that
differ.
"""


class Manifest(Struct, frozen=True):
    """Content of `manifest.json`."""

    format: str
    campaign: str
    packed: str
    """Time of packing, UTC."""
    versions: Mapping[str, str]
    """Versions of this package (with a hash of its source), Python, numpy and the platform."""
    files: Mapping[str, str]
    """SHA-256 of every file in the bundle except the manifest, by name."""
    drawn: tuple[int, ...]
    """Sampled seeds. The runs of these seeds were repeated before packing, and their recordings are in the bundle."""
    inputs: Mapping[str, str] = {}
    """SHA-256 of each file named by a setting, by the path in the setting."""


class Packed(Struct, frozen=True):
    """Summary of a written bundle, or the differing runs for which no bundle was written."""

    bundle: str
    """File name of the bundle."""
    sha256: str
    """SHA-256 of the bundle; empty if none was written."""
    runs: int
    drawn: tuple[int, ...]
    recordings: int
    left_out: int
    """Number of recordings of failed runs that did not fit in the bundle."""
    differing: tuple[RepeatedRun, ...]
    """Repeated runs whose figures differ from the results."""
    inputs: int = 0
    """Number of files named by settings."""

    @property
    def lines(self) -> Iterator[str]:
        """Summary as text for the terminal, line by line."""
        if self.differing:
            yield f"not packed: repeated runs differ from the results, {len(self.differing)} of them"
            for run in self.differing:
                yield from run.lines
            return
        seeds = ", ".join(map(str, self.drawn)) or "none"
        parts = [format_count(self.runs, "run"), format_count(self.recordings, "recording")]
        if self.inputs:
            parts.append(f"{format_count(self.inputs, 'file')} that settings name")
        yield f"{self.bundle}: {', '.join(parts)}; repeated seeds: {seeds}"
        if self.left_out:
            yield f"  no room for {self.left_out} recordings of runs that failed"
        yield f"  SHA-256 {self.sha256}"


def format_count(count: int, word: str) -> str:
    """Format a count with its noun, which is plural if needed."""
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def versions(more: Iterable[str] = ()) -> dict[str, str]:
    """Return the versions of everything that affects the bits of a run, and the versions of the packages in `more`."""
    return {
        "hil-bridge": code_version(),
        "Python": platform.python_version(),
        **{name: _version(name) for name in (*PACKAGES, *more)},
        "platform": platform.platform(),
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except (PackageNotFoundError, ValueError):
        return MISSING


def draw_seeds(plan: Plan, runs: Iterable[Done], count: int) -> tuple[int, ...]:
    """Return a sample of `count` seeds of these runs.

    The order of selection depends on the plan alone, so a larger sample contains every smaller one.
    """

    def place(seed: int) -> str:
        return hashlib.sha256(f"{plan.identity} {seed}".encode()).hexdigest()

    return tuple(sorted({run.seed for run in runs}, key=place)[:count])


def pack(
    store: Store, path: Path, count: int, overwrite: bool, advance: Advance = lambda *counts: None
) -> Packed:
    """Write a bundle of these results. The runs of `count` seeds are repeated first; if any differs, no bundle is
    written.

    Raises ConfigError for results of another version of the code, for a missing file named by a setting, and if the
    bundle cannot be written.
    """
    check_place(path, overwrite)
    plan, runs = store.plan(), list(store.runs())
    if (code := store.fact("code")) != plan.code:
        raise ConfigError(
            f"{store.path} has results of version {code}, and this is {plan.code}; pack them with that version, "
            "or run the campaign again"
        )
    drawn = draw_seeds(plan, runs, count)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        store.copy(folder / RESULTS)
        inputs = pack_inputs(folder, plan, runs)
        recordings = folder / RECORDINGS
        recordings.mkdir()
        again = [
            replace(repeat_of(plan, done), save=recordings / f"{done.key}.mcap")
            for done in runs
            if done.seed in drawn
        ]
        differing = tuple(repeat_runs(again, advance))
        if differing:
            return Packed(path.name, "", len(runs), drawn, 0, 0, differing)
        left_out = _add_failing(folder, store, runs)
        names = sorted(str(one.relative_to(folder)) for one in folder.rglob("*") if one.is_file())
        files = {name: hash_file(folder / name) for name in names}
        known = versions(computing_packages(plan))
        manifest = Manifest(FORMAT, plan.name, now(), known, files, drawn, inputs)
        data = _zip(folder, names, msgspec.json.format(msgspec.json.encode(manifest), indent=1))
    write_atomically(path, data, overwrite)
    count_recordings = sum(name.startswith(RECORDINGS) for name in names)
    sha256 = hashlib.sha256(data).hexdigest()
    return Packed(path.name, sha256, len(runs), drawn, count_recordings, left_out, (), len(inputs))


def _add_failing(folder: Path, store: Store, runs: Iterable[Done]) -> int:
    """Add the recordings of failed runs, worst first; return the number of recordings that did not fit."""
    size = sum(one.stat().st_size for one in folder.rglob("*") if one.is_file())
    count, left_out = sum(1 for _ in folder.rglob("*")), 0
    for done in worst_first(store.plan().criteria, runs):
        name = f"{done.key}.mcap"
        source, target = store.folder / name, folder / RECORDINGS / name
        if done.recording != name or target.exists() or not source.is_file():
            continue
        size, count = size + source.stat().st_size, count + 1
        if size > UNPACKED_LIMIT_BYTES or count >= FILES_MOST:
            left_out += 1
        else:
            target.write_bytes(source.read_bytes())
    return left_out


def _zip(folder: Path, names: Iterable[str], manifest: bytes) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", allowZip64=False) as target:
        for name, data in ((MANIFEST, manifest), *((name, (folder / name).read_bytes()) for name in names)):
            entry = zipfile.ZipInfo(name, _ZIP_EPOCH)
            entry.external_attr = 0o100644 << 16
            target.writestr(entry, data, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
