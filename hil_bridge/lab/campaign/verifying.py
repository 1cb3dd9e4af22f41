"""Verification of a bundle: its files are checked against the manifest, and a sample of its runs is repeated bit by
bit.

Nothing in a bundle is trusted: it may be truncated, altered or a zip bomb, or contain paths outside its folder.
"""

import os
import re
import shutil
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import msgspec
from msgspec import Struct
from pydantic import ValidationError

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, open_ordinary, read_text
from hil_bridge.lab.campaign.bundle import (
    FILES_MOST,
    FORMAT,
    MANIFEST,
    RECORDINGS,
    RESULTS,
    UNPACKED_LIMIT_BYTES,
    Advance,
    Manifest,
    draw_seeds,
    format_count,
    versions,
)
from hil_bridge.lab.campaign.inputs import INPUTS, hash_file, with_inputs
from hil_bridge.lab.campaign.judging import REFUSED, configure_run
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.repeating import RepeatedRun, RepeatJob, repeat_of, repeat_runs
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.settings.configuration import explain

_NAME = re.compile(
    rf"{re.escape(MANIFEST)}|{re.escape(RESULTS)}|{RECORDINGS}/[0-9a-f]{{16}}\.mcap|{INPUTS}/[0-9a-f]{{64}}"
)
_FOLDERS = (f"{RECORDINGS}/", f"{INPUTS}/")
"""Names of the empty folder entries that other zip programs add."""
_END = struct.Struct("<4s4H2LH")
"""Layout of the end of central directory record. Source: APPNOTE.TXT of PKWARE, 4.3.16."""
_LOCATOR_BYTES = 20
"""Size of the Zip64 end of central directory locator, which precedes that record, bytes. Source: APPNOTE.TXT of
PKWARE, 4.3.15.
"""
_ENTRY_LIMIT_BYTES = 512
"""Largest directory entry of a file, bytes. Chosen: five times the size that our file names need."""
_DAMAGES = (zipfile.BadZipFile, zlib.error, EOFError, ValueError, RuntimeError, struct.error)


class OtherVersion(Struct, frozen=True):
    """Package whose version on this computer differs from its version in the bundle."""

    package: str
    packed: str
    here: str


class Verified(Struct, frozen=True):
    """Result of verifying a bundle."""

    bundle: str
    """File name of the bundle."""
    sha256: str
    """SHA-256 of the bundle."""
    campaign: str
    packed: str
    """Time of packing, UTC."""
    files: int
    """Number of files in the manifest."""
    altered: tuple[str, ...]
    """Files that are damaged or differ from the manifest."""
    missing: tuple[str, ...]
    """Files of the manifest that are not in the bundle."""
    unknown: tuple[str, ...]
    """Files of the bundle that are not in the manifest."""
    other_versions: tuple[OtherVersion, ...]
    inputs: Mapping[str, str]
    """Files of the bundle that are named by settings, by the path in the settings."""
    repeated: tuple[int, ...] = ()
    """Seeds whose runs were repeated; empty if a file differs from the manifest."""
    runs: int = 0
    """Number of repeated runs."""
    recordings: int = 0
    """Number of repeated runs compared with their recordings, cycle by cycle."""
    differing: tuple[RepeatedRun, ...] = ()
    """Repeated runs that differ from the results in any bit."""
    not_repeated: tuple[str, ...] = ()
    """Reasons why runs cannot be repeated on this computer, each with the number of runs and a remedy."""

    @property
    def intact(self) -> bool:
        """Whether the files match the manifest."""
        return not (self.altered or self.missing or self.unknown)

    @property
    def good(self) -> bool:
        """Whether the files match the manifest and all repeated runs are identical."""
        return self.intact and not self.not_repeated and not self.differing

    @property
    def lines(self) -> Iterator[str]:
        """Text for the terminal, line by line: what was checked, and the result."""
        yield f"{self.bundle}: campaign {self.campaign}, packed {self.packed} UTC"
        yield f"  SHA-256 {self.sha256}"
        for names, word in ((self.altered, "altered"), (self.missing, "missing"), (self.unknown, "unknown")):
            yield from (f"{word}: {name}{self._settings_name(name)}" for name in names)
        if self.intact:
            yield f"{self.files} files match the manifest"
        for other in self.other_versions:
            yield f"another version of {other.package}: packed with {other.packed}, here {other.here}"
        yield from self.not_repeated
        if not self.runs:
            yield "no run was repeated"
            return
        runs, seeds = format_count(self.runs, "run"), _format_seeds(self.repeated)
        yield f"{runs} of {seeds} repeated, {self.recordings} compared with their recordings"
        for run in self.differing:
            yield from run.lines
        if not self.differing:
            yield "  identical to the last bit"
        elif self.other_versions:
            yield "  other versions may compute different results; verify with the versions of the bundle"

    def _settings_name(self, name: str) -> str:
        """Return a note with the path of a file in the settings; empty for a file that no setting names."""
        paths = [format_path(Path(path)) for path, packed in self.inputs.items() if packed == name]
        return f", which the settings name {' and '.join(paths)}" if paths else ""


def verify(path: Path, count: int | None, advance: Advance = lambda *counts: None) -> Verified:
    """Verify a bundle. The runs of `count` seeds are repeated; the default is all seeds that were sampled when the
    bundle was packed.

    Raises ConfigError for a file that is not a bundle, or whose manifest cannot be read.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hashes = unpack(path, folder)
        if not hashes.pop(MANIFEST):
            raise ConfigError(f"{format_path(path)}: {MANIFEST} is damaged; get the bundle again")
        manifest = _manifest(path, folder / MANIFEST)
        files, here = manifest.files, versions(manifest.versions.keys() - versions().keys())
        checked = Verified(
            path.name,
            hash_file(path),
            manifest.campaign,
            manifest.packed,
            len(files),
            tuple(name for name in sorted(hashes.keys() & files.keys()) if not _fits(name, hashes, files)),
            tuple(sorted(files.keys() - hashes.keys())),
            tuple(sorted(hashes.keys() - files.keys())),
            tuple(
                OtherVersion(package, packed, here[package])
                for package, packed in manifest.versions.items()
                if here[package] != packed
            ),
            {path: f"{INPUTS}/{sha256}" for path, sha256 in manifest.inputs.items()},
        )
        if not checked.intact or count == 0:
            return checked
        try:
            repeats, problems = _repeats(folder, manifest, count)
        except ConfigError as error:
            return msgspec.structs.replace(checked, not_repeated=(f"cannot read the results: {error}",))
        return msgspec.structs.replace(
            checked,
            repeated=tuple(sorted({repeat.done.seed for repeat in repeats})),
            runs=len(repeats),
            recordings=sum(repeat.recording is not None for repeat in repeats),
            differing=tuple(repeat_runs(repeats, advance)),
            not_repeated=problems,
        )


def _fits(name: str, hashes: Mapping[str, str], files: Mapping[str, str]) -> bool:
    """Return whether a file matches the manifest and, if it is named by a setting, the hash in its own name."""
    sha256 = hashes[name]
    return sha256 == files[name] and (not name.startswith(f"{INPUTS}/") or name == f"{INPUTS}/{sha256}")


def _manifest(path: Path, place: Path) -> Manifest:
    try:
        manifest = msgspec.json.decode(read_text(place), type=Manifest)
    except (msgspec.MsgspecError, ConfigError, RecursionError) as error:
        raise ConfigError(f"{format_path(path)}: cannot read {MANIFEST}: {error}") from error
    if manifest.format != FORMAT:
        raise ConfigError(
            f"{format_path(path)} has the bundle format {manifest.format[:80]!r}, and this version reads {FORMAT!r}"
        )
    return manifest


def _repeats(folder: Path, manifest: Manifest, count: int | None) -> tuple[list[RepeatJob], tuple[str, ...]]:
    """Return the runs that can be repeated on this computer, and the reasons why others cannot. Raises ConfigError."""
    with Store.open(folder / RESULTS) as store:
        plan, runs = store.plan(), list(store.runs())
    drawn = manifest.drawn if count is None else draw_seeds(plan, runs, count)
    inputs = {
        path: sha256 for path, sha256 in manifest.inputs.items() if f"{INPUTS}/{sha256}" in manifest.files
    }
    repeats: list[RepeatJob] = []
    left: dict[str, list[int]] = {}
    for done in runs:
        if done.seed not in drawn:
            continue
        repeat = _repeat(plan, done, folder, inputs)
        if isinstance(repeat, str):
            left.setdefault(repeat, []).append(done.seed)
        else:
            repeats.append(repeat)
    return repeats, tuple(
        f"not repeated, {format_count(len(seeds), 'run')} of {_format_seeds(seeds)}: {why}"
        for why, seeds in left.items()
    )


def _repeat(plan: Plan, done: Done, folder: Path, inputs: Mapping[str, str]) -> RepeatJob | str:
    """Return the run with the data files of the bundle, or the reason why it cannot be repeated on this computer.

    Code from a bundle is never executed: the user has to install a plug-in controller.
    """
    recording = folder / RECORDINGS / f"{done.key}.mcap"
    try:
        repeat = repeat_of(plan, done)
        job = with_inputs(repeat.job, folder, inputs)
        if done.outcome != REFUSED:
            configure_run(job)
    except ValidationError as error:
        return explain(error, None, set()).without_source
    except ConfigError as error:
        return error.without_source
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        return f"cannot read their settings: {error}"
    return replace(repeat, job=job, recording=recording if recording.is_file() else None)


def _format_seeds(seeds: Sequence[int]) -> str:
    seeds = sorted({*seeds})
    return f"{'seed' if len(seeds) == 1 else 'seeds'} {', '.join(map(str, seeds))}"


def unpack(path: Path, folder: Path) -> dict[str, str]:
    """Write the files of a bundle to an empty folder. Return their SHA-256 by name, which is empty for a damaged
    file.

    Raises ConfigError for a file that is not a bundle, is too large, or has unexpected contents.
    """
    with open_ordinary(path) as file:
        try:
            _check_end(file, path)
            with zipfile.ZipFile(file) as packed:
                entries = [one for one in packed.infolist() if one.filename not in _FOLDERS]
                for problem in _problems(entries):
                    raise ConfigError(f"{format_path(path)} {problem}; it is not a bundle of this program")
                return {entry.filename: _unpack_one(packed, entry, folder) for entry in entries}
        except OSError as error:
            raise ConfigError(f"cannot unpack {format_path(path)}: {error.strerror or error}") from error
        except _DAMAGES as error:
            raise ConfigError(
                f"{format_path(path)} is not a bundle (a .zip file), or its end is damaged: {error}"
            ) from error


def _check_end(file: BinaryIO, path: Path) -> None:
    """Check the size of a bundle and its number of files, before zipfile reads the complete directory into memory."""
    size = file.seek(0, os.SEEK_END)
    if size > UNPACKED_LIMIT_BYTES:
        raise ConfigError(f"{format_path(path)} has {size} bytes; at most {UNPACKED_LIMIT_BYTES} are allowed")
    file.seek(max(size - _END.size - _LOCATOR_BYTES, 0))
    tail = file.read()
    mark, _, _, _, count, directory, _, _ = _END.unpack(tail[-_END.size :])
    if mark != b"PK\5\6":
        raise zipfile.BadZipFile("no end of central directory record")
    is_zip64 = tail[: -_END.size].startswith(b"PK\6\7")
    if is_zip64 or count > FILES_MOST or directory > count * _ENTRY_LIMIT_BYTES:
        raise ConfigError(f"{format_path(path)} has more than {FILES_MOST} files")


def _problems(entries: Sequence[zipfile.ZipInfo]) -> Iterator[str]:
    names = [entry.orig_filename for entry in entries]
    for entry in entries:
        usual = entry.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
        if not usual or not _NAME.fullmatch(entry.orig_filename):
            yield f"contains {entry.orig_filename[:80]!r}{'' if usual else ', compressed by another method'}"
    if len(names) > len(set(names)):
        yield "contains a file twice"
    if len(names) > FILES_MOST or sum(entry.file_size for entry in entries) > UNPACKED_LIMIT_BYTES:
        yield f"contains more than {FILES_MOST} files or {UNPACKED_LIMIT_BYTES} bytes"
    if MANIFEST not in names:
        yield f"contains no {MANIFEST}"


def _unpack_one(packed: zipfile.ZipFile, entry: zipfile.ZipInfo, folder: Path) -> str:
    """Write a file up to the size in its directory entry. Return its SHA-256, or an empty text if it is damaged."""
    place = folder / entry.filename
    place.parent.mkdir(exist_ok=True)
    with place.open("xb") as target:
        try:
            with packed.open(entry) as source:
                shutil.copyfileobj(source, target)
        except _DAMAGES:
            return ""
    return hash_file(place)
