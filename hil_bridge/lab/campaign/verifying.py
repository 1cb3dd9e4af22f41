"""Verifying a bundle: its files against the manifest, and a sample of its runs, done again bit by bit."""

import tempfile
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
from msgspec import Struct
from pydantic import ValidationError

from hil_bridge.control.controllers import controller_names
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, read_text
from hil_bridge.lab.campaign.bundle import FORMAT, Manifest, count_words, draw_seeds, plan_text, versions
from hil_bridge.lab.campaign.inputs import controller_named, with_inputs
from hil_bridge.lab.campaign.judging import REFUSED, Job
from hil_bridge.lab.campaign.overlay import config_with
from hil_bridge.lab.campaign.plan import Plan
from hil_bridge.lab.campaign.repeating import CheckedRun, Repeat, job_again, repeat_runs
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.lab.campaign.unpacking import (
    INPUTS,
    MANIFEST,
    MANIFEST_LIMIT_BYTES,
    PLAN,
    RECORDINGS,
    RESULTS,
    hash_file,
    unpack,
)
from hil_bridge.settings.configuration import explain

Advance = Callable[[int, int], object]
"""Told how many runs have been repeated since, and how many of them differ."""


class OtherVersion(Struct, frozen=True):
    """A package of which the bundle names another version than this computer has."""

    package: str
    packed: str
    here: str


class NotRepeated(Struct, frozen=True):
    """Runs that cannot be repeated here, all for the same reason."""

    why: str
    """Reason, and remedy."""
    seeds: tuple[int, ...]
    runs: int

    @property
    def text(self) -> str:
        """For people."""
        return f"not repeated, {count_words(self.runs, 'run')} of {_seed_words(self.seeds)}: {self.why}"


class Verified(Struct, frozen=True):
    """The result of the check."""

    bundle: str
    """File name."""
    sha256: str
    """Of the bundle."""
    campaign: str
    packed: str
    """When, UTC."""
    files: int
    """Files that the manifest names."""
    altered: tuple[str, ...]
    """Files that are damaged, or are not those of the manifest."""
    missing: tuple[str, ...]
    """Files of the manifest that the bundle lacks."""
    unknown: tuple[str, ...]
    """Files that the manifest does not name."""
    unreadable: str
    """Why the results cannot be read; empty where they can."""
    seeds: int
    """Seeds of the results, whose runs were all compared with the manifest."""
    seeds_altered: tuple[int, ...]
    """Seeds whose runs are not those of the manifest, or do not belong to their keys."""
    other_versions: tuple[OtherVersion, ...]
    repeated: tuple[int, ...]
    """Seeds whose runs were repeated."""
    runs: int
    """Repeated runs."""
    recordings: int
    """Repeated runs that were compared with their recordings, cycle by cycle."""
    differing: tuple[CheckedRun, ...]
    """Repeated runs that are not the same to the last bit."""
    not_repeated: tuple[NotRepeated, ...] = ()
    """Runs of these seeds that cannot be repeated here."""
    inputs: Mapping[str, str] = {}
    """Files of the bundle that settings name, by the path in the settings."""

    @property
    def good(self) -> bool:
        """Nothing was altered, and nothing differs."""
        wrong = (
            self.altered,
            self.missing,
            self.unknown,
            self.unreadable,
            self.seeds_altered,
            self.differing,
            self.not_repeated,
        )
        return not any(wrong)

    @property
    def lines(self) -> Iterator[str]:
        """For people: what was checked, and what was found."""
        yield f"{self.bundle}: campaign {self.campaign}, packed {self.packed} UTC"
        yield f"  SHA-256 {self.sha256}"
        for names, word in ((self.altered, "altered"), (self.missing, "missing"), (self.unknown, "unknown")):
            yield from (f"{word}: {name}{self._settings_name(name)}" for name in names)
        if not (self.altered or self.missing or self.unknown):
            yield f"{self.files} files are those of the manifest"
        for other in self.other_versions:
            yield f"another version of {other.package}: packed with {other.packed}, here {other.here}"
        if self.unreadable:
            yield f"the results cannot be read: {self.unreadable}"
            return
        yield from (f"altered: the runs of seed {seed}" for seed in self.seeds_altered)
        if not self.seeds_altered:
            yield f"the runs of {self.seeds} seeds are those of the manifest"
        yield from self._repeated()

    def _settings_name(self, name: str) -> str:
        """Path by which the settings name a file of the bundle, in words; empty for every other file."""
        paths = [format_path(Path(path)) for path, packed in self.inputs.items() if packed == name]
        return f", which the settings name {' and '.join(paths)}" if paths else ""

    def _repeated(self) -> Iterator[str]:
        for one in self.not_repeated:
            yield one.text
        if not self.repeated:
            yield "no run was repeated"
            return
        seeds = _seed_words(self.repeated)
        yield f"{count_words(self.runs, 'run')} of {seeds} repeated, {self.recordings} compared with their recordings"
        for run in self.differing:
            yield from run.lines
        if not self.differing:
            yield "  the same to the last bit"
        elif self.other_versions:
            yield "  another version may decide otherwise; verify with the versions of the bundle"


class _Found(NamedTuple):
    """The findings on the results of a bundle."""

    seeds: int = 0
    seeds_altered: tuple[int, ...] = ()
    repeated: tuple[int, ...] = ()
    checked: tuple[CheckedRun, ...] = ()
    not_repeated: tuple[NotRepeated, ...] = ()
    other_plan: bool = False
    """The plan as JSON is not that of the results."""


def verify(path: Path, count: int | None, advance: Advance = lambda *told: None) -> Verified:
    """Check a bundle. `count` seeds are repeated, by default those that were drawn when it was packed.

    Raises ConfigError for a file that is no bundle, or whose manifest cannot be read.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hashes = unpack(path, folder)
        if not hashes.pop(MANIFEST):
            raise ConfigError(f"{format_path(path)}: its {MANIFEST} is damaged; get the bundle anew")
        manifest = _manifest(path, folder / MANIFEST)
        whole = {name for name, sha256 in hashes.items() if _is_whole(name, sha256, manifest)}
        altered = (hashes.keys() & manifest.files.keys()) - whole
        found, unreadable = _Found(), f"there is no whole {RESULTS}"
        if hashes.get(RESULTS):
            try:
                found, unreadable = _check_results(folder, manifest, count, whole, advance), ""
            except ConfigError as error:
                unreadable = str(error)
        if found.other_plan:
            altered.add(PLAN)
        return Verified(
            path.name,
            hash_file(path),
            manifest.campaign,
            manifest.packed,
            len(manifest.files),
            tuple(sorted(altered)),
            tuple(sorted(manifest.files.keys() - hashes.keys())),
            tuple(sorted(hashes.keys() - manifest.files.keys())),
            unreadable,
            found.seeds,
            found.seeds_altered,
            tuple(_other_versions(manifest.versions)),
            found.repeated,
            len(found.checked),
            sum(run.cycles is not None for run in found.checked),
            tuple(run for run in found.checked if not run.equal),
            found.not_repeated,
            {path: f"{INPUTS}/{sha256}" for path, sha256 in manifest.inputs.items()},
        )


def _manifest(path: Path, place: Path) -> Manifest:
    try:
        manifest = msgspec.json.decode(read_text(place, MANIFEST_LIMIT_BYTES), type=Manifest)
    except (msgspec.MsgspecError, ConfigError, RecursionError) as error:
        raise ConfigError(f"{format_path(path)}: its {MANIFEST} is none that can be read: {error}") from error
    if manifest.format != FORMAT:
        raise ConfigError(
            f"{format_path(path)} is a bundle in the form {manifest.format[:80]!r}, and this version reads {FORMAT!r}"
        )
    return manifest


def _check_results(
    folder: Path, manifest: Manifest, count: int | None, whole: Container[str], advance: Advance
) -> _Found:
    """Compare the runs with the manifest and with their keys, and repeat some. `whole` are files to be trusted."""
    with Store.open(folder / RESULTS) as store:
        plan, hashes, code = store.plan(), store.seed_hashes(), store.fact("code")
        runs = list(store.runs())
    altered = {
        seed for seed in hashes.keys() | manifest.seeds.keys() if hashes.get(seed) != manifest.seeds.get(seed)
    }
    for done in runs:
        if plan.cases[done.number].key(code, done.seed, done.table) != done.key:
            altered.add(done.seed)
    wanted = manifest.drawn if count is None else draw_seeds(plan, hashes, count)
    again, left = _repeats(folder, manifest, plan, [done for done in runs if done.seed in wanted], whole)
    checked = repeat_runs(again, advance)
    repeated = tuple(sorted({run.seed for run in checked}))
    other = (folder / PLAN).is_file() and (folder / PLAN).read_bytes() != plan_text(plan)
    return _Found(len(hashes), tuple(sorted(altered)), repeated, tuple(checked), left, other)


def _repeats(
    folder: Path, manifest: Manifest, plan: Plan, runs: Iterable[Done], whole: Container[str]
) -> tuple[list[Repeat], tuple[NotRepeated, ...]]:
    """The runs that can be repeated here, with files of the bundle where their settings name some; and the others."""
    again: list[Repeat] = []
    left: dict[str, list[int]] = {}
    for done in runs:
        try:
            job = with_inputs(job_again(plan, done), folder, manifest.inputs, whole)
            problem = "" if done.outcome == REFUSED else _problem(job, manifest.packages)
        except ConfigError as error:
            problem = f"{error}; get the bundle anew"
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            problem = f"their settings cannot be read: {error}"
        if problem:
            left.setdefault(problem, []).append(done.seed)
        else:
            name = f"{RECORDINGS}/{done.key}.mcap"
            again.append(Repeat(job, done.figures, folder / name if name in whole else None))
    return again, tuple(NotRepeated(why, tuple(sorted({*seeds})), len(seeds)) for why, seeds in left.items())


def _problem(job: Job, packages: Mapping[str, str]) -> str:
    """Why a run cannot be done here; empty where it can. Code of a bundle is never run: a controller of
    another package has to be installed by a person.
    """
    name = controller_named(job.config, job.table)
    if name not in controller_names():
        package = packages.get(name, "")[:80] or "the package that offers it"
        return f"the controller {name[:80]!r} is not installed here, and a bundle holds no programs: install {package}"
    try:
        config_with(job.config, job.table, job.seed)
    except ValidationError as error:
        return explain(error, None, set()).without_source
    except ConfigError as error:
        return str(error)
    return ""


def _is_whole(name: str, sha256: str, manifest: Manifest) -> bool:
    """Whether a file is that of the manifest, and one that settings name that of its own name."""
    if not sha256 or manifest.files.get(name) != sha256:
        return False
    return not name.startswith(f"{INPUTS}/") or name == f"{INPUTS}/{sha256}"


def _seed_words(seeds: Sequence[int]) -> str:
    return f"{'seed' if len(seeds) == 1 else 'seeds'} {', '.join(map(str, seeds))}"


def _other_versions(packed: Mapping[str, str]) -> Iterator[OtherVersion]:
    here = versions(packed.keys() - versions().keys())
    for package, version in packed.items():
        if (mine := here[package]) != version:
            yield OtherVersion(package, version, mine)
