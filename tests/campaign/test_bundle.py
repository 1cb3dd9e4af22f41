"""Campaign bundles: packing, verification, every kind of alteration, and files that only resemble a bundle."""

import hashlib
import io
import json
import sqlite3
import struct
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.bundle import UNPACKED_LIMIT_BYTES, draw_seeds, versions
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.verifying import unpack, verify
from tests.bundles import Files, files_of, repack, with_manifest

pytestmark = pytest.mark.sweep


def invoke(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [*map(str, arguments)], catch_exceptions=False)


@pytest.fixture(scope="module")
def bundle(short_results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bundle of SHORT, with one sampled seed."""
    path = tmp_path_factory.mktemp("bundle") / "short.zip"
    ended = invoke("campaign", "bundle", short_results, "-o", path, "--json")
    assert ended.exit_code == 0, ended.output
    packed = json.loads(ended.stdout)
    assert (packed["bundle"], packed["runs"], packed["left_out"]) == ("short.zip", 8, 0)
    assert packed["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    return path


def with_results(files: Files, folder: Path, statement: str) -> Files:
    """Bundle whose results were modified by an SQL statement."""
    path = folder / "changed.sqlite"
    path.write_bytes(files["results.sqlite"])
    connection = sqlite3.connect(path)
    assert connection.execute(statement).rowcount == 1
    connection.commit()
    connection.close()
    return {**files, "results.sqlite": path.read_bytes()}


@pytest.mark.full
def test_bundle_contains_failed_and_sampled_recordings(bundle: Path, short_results: Path) -> None:
    files = files_of(bundle)
    manifest = json.loads(files["manifest.json"])
    with Store.open(short_results) as store:
        plan, runs = store.plan(), list(store.runs())
    assert manifest["drawn"] == list(draw_seeds(plan, runs, 1))
    kept = {run.key for run in runs if run.failed or run.seed in manifest["drawn"]}
    assert len(kept) == 6
    assert set(files) == {
        "manifest.json",
        "results.sqlite",
        *(f"recordings/{key}.mcap" for key in kept),
    }
    assert manifest["versions"] == versions()


@pytest.mark.full
def test_intact_bundle_is_verified(bundle: Path) -> None:
    ended = invoke("campaign", "verify", bundle)
    assert ended.exit_code == 0, ended.output
    assert "7 files match the manifest" in ended.output
    assert "4 runs of seed " in ended.output
    assert ended.output.endswith("4 compared with their recordings\n  identical to the last bit\n")
    output = json.loads(invoke("campaign", "verify", bundle, "--seeds", 2, "--json").stdout)
    assert (output["repeated"], output["runs"], output["recordings"], output["differing"]) == (
        [1, 2],
        8,
        6,
        [],
    )
    assert output["sha256"] == hashlib.sha256(bundle.read_bytes()).hexdigest()


@pytest.mark.full
def test_altered_byte_is_reported_with_file(bundle: Path, tmp_path: Path) -> None:
    """The byte is inside the packed data: one in the zip's own headers changes no file."""
    path, data = tmp_path / "altered.zip", bundle.read_bytes()
    with zipfile.ZipFile(bundle) as packed:
        entries = packed.infolist()
    for entry in entries:
        start = entry.header_offset + 30 + len(entry.filename)
        for quarter in (1, 2, 3):
            byte = start + quarter * entry.compress_size // 4
            path.write_bytes(data[:byte] + bytes([data[byte] ^ 1]) + data[byte + 1 :])
            if entry.filename == "manifest.json":
                with pytest.raises(ConfigError, match=r"altered\.zip: manifest\.json is damaged"):
                    verify(path, 0)
                continue
            verified = verify(path, 0)
            assert verified.altered == (entry.filename,)
            assert not verified.good
    ended = invoke("campaign", "verify", path, "--seeds", 0)
    assert ended.exit_code == 1
    assert f"altered: {entries[-1].filename}\n" in ended.output


def test_byte_altered_before_packing_is_reported(bundle: Path, tmp_path: Path) -> None:
    files = files_of(bundle)
    name = next(name for name in files if name.startswith("recordings/"))
    data = bytearray(files[name])
    data[len(data) // 2] ^= 0x80
    verified = verify(repack(tmp_path / "b.zip", {**files, name: bytes(data)}), 0)
    assert verified.altered == (name,)
    del files[name]
    verified = verify(repack(tmp_path / "b.zip", files), 0)
    assert (verified.altered, verified.missing, verified.good) == ((), (name,), False)
    files["recordings/0123456789abcdef.mcap"] = b""
    assert verify(repack(tmp_path / "b.zip", files), 0).unknown == ("recordings/0123456789abcdef.mcap",)


MORE_FORCE = (
    "UPDATE runs SET figures = json_set(figures, '$.force_true_max_n', 1.5) WHERE rowid = "
    "(SELECT min(rowid) FROM runs WHERE seed = {seed})"
)


def test_altered_results_are_reported_and_not_opened(bundle: Path, tmp_path: Path) -> None:
    files = with_results(files_of(bundle), tmp_path, MORE_FORCE.format(seed=1))
    verified = verify(repack(tmp_path / "b.zip", files), None)
    assert (verified.altered, verified.runs, verified.good) == (("results.sqlite",), 0, False)


def test_differing_run_is_reported_despite_valid_hashes(bundle: Path, tmp_path: Path) -> None:
    files = files_of(bundle)
    (drawn,) = json.loads(files["manifest.json"])["drawn"]
    files = with_results(files, tmp_path, MORE_FORCE.format(seed=drawn))
    verified = verify(repack(tmp_path / "b.zip", with_manifest(files)), None)
    assert verified.altered == ()
    (run,) = verified.differing
    assert (run.seed, [one.figure for one in run.differences], run.cycle) == (
        drawn,
        ["force_true_max_n"],
        None,
    )


def test_recording_of_other_run_differs_in_first_cycle(bundle: Path, tmp_path: Path) -> None:
    files = files_of(bundle)
    (drawn,) = json.loads(files["manifest.json"])["drawn"]
    (tmp_path / "results.sqlite").write_bytes(files["results.sqlite"])
    with Store.open(tmp_path / "results.sqlite") as store:
        one, other = [f"recordings/{run.key}.mcap" for run in store.runs("seed = ?", [drawn])][:2]
    files = with_manifest({**files, one: files[other]})
    verified = verify(repack(tmp_path / "b.zip", files), None)
    (run,) = verified.differing
    assert (run.seed, run.differences, f"recordings/{run.key}.mcap") == (drawn, (), one)
    assert run.cycle is not None


def test_unreadable_recording_is_reported(bundle: Path, tmp_path: Path) -> None:
    files = files_of(bundle)
    (drawn,) = json.loads(files["manifest.json"])["drawn"]
    (tmp_path / "results.sqlite").write_bytes(files["results.sqlite"])
    with Store.open(tmp_path / "results.sqlite") as store:
        key = next(store.runs("seed = ?", [drawn])).key
    files = with_manifest({**files, f"recordings/{key}.mcap": b"nothing"}, versions={"numpy": "1.0"})
    verified = verify(repack(tmp_path / "b.zip", files), None)
    lines = list(verified.lines)
    assert f"{key}: seed {drawn}, " in "\n".join(lines)
    assert "  differs: the recording, from cycle 0 on" in lines
    assert (
        lines[-1] == "  other versions may compute different results; verify with the versions of the bundle"
    )


def test_different_version_is_reported_without_failure(bundle: Path, tmp_path: Path) -> None:
    files = with_manifest(files_of(bundle), versions={**versions(), "numpy": "1.0", "Python": "3.9.1"})
    path = repack(tmp_path / "b.zip", files)
    ended = invoke("campaign", "verify", path)
    assert ended.exit_code == 0, ended.output
    assert f"another version of numpy: packed with 1.0, here {versions()['numpy']}\n" in ended.output
    output = json.loads(invoke("campaign", "verify", path, "--seeds", 0, "--json").stdout)
    assert [one["package"] for one in output["other_versions"]] == ["Python", "numpy"]


def test_unreadable_results_are_reported(bundle: Path, tmp_path: Path) -> None:
    files = with_manifest({**files_of(bundle), "results.sqlite": b"no database"})
    verified = verify(repack(tmp_path / "b.zip", files), None)
    (problem,) = verified.not_repeated
    assert problem.startswith("cannot read the results: ")
    assert not verified.good


def test_irreproducible_results_are_not_packed(short_results: Path, tmp_path: Path) -> None:
    path = tmp_path / "short.sqlite"
    with Store.open(short_results) as store:
        store.copy(path)
        (drawn,) = draw_seeds(store.plan(), store.runs(), 1)
    (tmp_path / "other.sqlite").write_bytes(
        with_results({"results.sqlite": path.read_bytes()}, tmp_path, MORE_FORCE.format(seed=drawn))[
            "results.sqlite"
        ]
    )
    ended = invoke("campaign", "bundle", tmp_path / "other.sqlite")
    assert ended.exit_code == 1
    assert "repeated runs differ from the results, 1 of them" in ended.output
    assert f": seed {drawn}, " in ended.output
    assert not (tmp_path / "other.zip").exists()


def test_results_of_other_code_version_are_not_packed(short_results: Path, tmp_path: Path) -> None:
    with Store.open(short_results) as store:
        store.copy(tmp_path / "older.sqlite")
    with Store.open(tmp_path / "older.sqlite") as store:
        store.keep("code", "0.1+0")
    with pytest.raises(ConfigError, match=r"has results of version 0\.1\+0, and this is "):
        invoke("campaign", "bundle", tmp_path / "older.sqlite", "--seeds", 0)


def test_existing_bundle_is_not_overwritten(bundle: Path, short_results: Path) -> None:
    before = bundle.read_bytes()
    with pytest.raises(ConfigError, match="already exists"):
        invoke("campaign", "bundle", short_results, "-o", bundle)
    assert bundle.read_bytes() == before


def entry(name: str, **changes: int) -> zipfile.ZipInfo:
    made = zipfile.ZipInfo(name)
    made.external_attr = 0o100644 << 16
    for key, value in changes.items():
        setattr(made, key, value)
    return made


def of_entries(*entries: zipfile.ZipInfo) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as target:
        for one in (entry("manifest.json"), *entries):
            target.writestr(one, b"{}")
    return made.getvalue()


def encrypted() -> bytes:
    """Mark the first file as encrypted in the zip directory."""
    data = bytearray(of_entries())
    data[data.rindex(b"PK\1\2") + 8] |= 1
    return bytes(data)


def longer(size: int) -> bytes:
    """Declare this size for the first file in the zip directory."""
    data = bytearray(of_entries())
    struct.pack_into("<L", data, data.rindex(b"PK\1\2") + 24, size)
    return bytes(data)


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: b"", "is not a bundle"),
        (lambda: b"[campaign]\nname = 'x'\n" * 9, "is not a bundle"),
        (lambda: of_entries()[:-1], "is not a bundle"),
        (lambda: of_entries(entry("../results.sqlite")), r"contains '\.\./results\.sqlite'"),
        (lambda: of_entries(entry("/etc/passwd")), "contains '/etc/passwd'"),
        (lambda: of_entries(entry("recordings/../../x.mcap")), "contains 'recordings/"),
        (lambda: of_entries(entry("recordings\\0123456789abcdef.mcap")), "contains 'recordings"),
        (lambda: of_entries(entry("recordings/0123456789abcdef.mcap\n")), "contains 'recordings"),
        (lambda: of_entries(entry("other/")), "contains 'other/'"),
        (lambda: of_entries(entry("notes.txt")), "contains 'notes.txt'"),
        (lambda: of_entries() + b"more", "is not a bundle"),
        (lambda: of_entries(entry("results.sqlite"), entry("results.sqlite")), "contains a file twice"),
        (encrypted, r"manifest\.json is damaged"),
        (
            lambda: of_entries(entry("results.sqlite", compress_type=zipfile.ZIP_BZIP2)),
            r"contains 'results\.sqlite', compressed by another method",
        ),
        (lambda: longer(UNPACKED_LIMIT_BYTES + 1), "contains more than 2000 files or 1073741824 bytes"),
        (
            lambda: of_entries()[:-12] + struct.pack("<2H2LH", 65535, 65535, 1 << 30, 0, 0)[2:],
            "more than 2000 files",
        ),
        (lambda: of_entries(), r"cannot read manifest\.json: "),
    ],
)
def test_non_bundle_file_is_refused(make: Callable[[], bytes], message: str, tmp_path: Path) -> None:
    path = tmp_path / "b.zip"
    path.write_bytes(make())
    with pytest.raises(ConfigError, match=message) as caught:
        verify(path, 0)
    assert "\n" not in str(caught.value)
    assert [one.name for one in tmp_path.iterdir()] == ["b.zip"]


def test_zip_without_manifest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"contains no manifest\.json"):
        verify(repack(tmp_path / "b.zip", {"results.sqlite": b"{}"}), 0)


def test_entry_larger_than_declared_is_damaged(bundle: Path, tmp_path: Path) -> None:
    """A zip bomb that declares a small size is read up to that size only."""
    bomb = repack(tmp_path / "b.zip", {**files_of(bundle), "results.sqlite": bytes(10_000_000)})
    data = bytearray(bomb.read_bytes())
    directory = data.index(b"results.sqlite", data.index(b"PK\1\2")) - 46
    struct.pack_into("<L", data, directory + 24, 100)
    bomb.write_bytes(data)
    folder = tmp_path / "out"
    folder.mkdir()
    assert unpack(bomb, folder)["results.sqlite"] == ""
    assert (folder / "results.sqlite").stat().st_size <= 100


def test_repacked_bundle_is_accepted(bundle: Path, tmp_path: Path) -> None:
    """The other program adds a separate entry for the folder."""
    path = repack(tmp_path / "b.zip", files_of(bundle))
    with zipfile.ZipFile(path, "a") as packed:
        packed.mkdir("recordings")
    assert verify(path, 0).good


def test_newer_manifest_format_is_reported(bundle: Path, tmp_path: Path) -> None:
    files = with_manifest(files_of(bundle), format="hil-bridge bundle 9")
    with pytest.raises(
        ConfigError, match=r"has the bundle format 'hil-bridge bundle 9', and this version reads '"
    ):
        verify(repack(tmp_path / "b.zip", files), 0)


def test_additional_seeds_extend_the_draws(short_results: Path) -> None:
    with Store.open(short_results) as store:
        plan, (run, *_) = store.plan(), store.runs()
    runs = [replace(run, seed=seed) for seed in range(100)]
    drawn = [draw_seeds(plan, runs, count) for count in (0, 3, 10, 200)]
    assert drawn[0] == ()
    assert drawn[2][:3] == drawn[1]
    assert sorted(drawn[3]) == list(range(100))
    assert max(drawn[2]) > 10
