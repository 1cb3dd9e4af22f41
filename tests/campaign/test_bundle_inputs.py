"""Bundles of campaigns whose settings name files, or use a plug-in controller."""

import hashlib
import json
import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.control.laws.rules import PAPER_RULES, rules_as_toml
from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.bundle import pack
from hil_bridge.lab.campaign.plan_file import read_plan
from hil_bridge.lab.campaign.store import Store
from hil_bridge.lab.campaign.verifying import verify
from hil_bridge.lab.campaign.working import missing, work
from tests.bundles import files_of, repack, with_manifest

ROOT = Path(__file__).resolve().parents[2]
TRAIN = runpy.run_path(str(ROOT / "examples" / "policy" / "train.py"))
PLAN = """
[campaign]
name = "{name}"
seeds = [1, 2]
{more}
[campaign.criteria]
outcome = "completed"
[config.run]
duration_s = 0.3
[config.robot]
emulated = "egm"
[config.sensor]
emulated = "ft300"
[config.task]
retract_mm = 2.0
[config.cell]
start_position_mm = [900.0, -100.0, 591.0]
"""
POLICY = """
[config.controller]
name = "policy"
parameters.file = "policy.onnx"
"""
LAW = """
    from dataclasses import dataclass
    from pathlib import Path
    from typing import ClassVar

    from hil_bridge.control import Command

    @dataclass(frozen=True)
    class Steady:
        name: ClassVar[str] = "steady"
        sample_ms: ClassVar[float] = 4.0
        file: str = ""

        def initial(self):
            return None

        def step(self, state, measurement, reference):
            return None, Command(measurement.commanded, 0.0)
"""


def results_of(folder: Path, text: str) -> Path:
    """Run a campaign in this folder and return its results."""
    (folder / "plan.toml").write_text(text)
    plan = read_plan(folder / "plan.toml")
    with Store.begin(folder / "plan.sqlite", plan) as store:
        work(plan, store, missing(plan, store), workers=1)
        assert [run.outcome for run in store.runs()] == ["completed"] * plan.count, [
            run.cause for run in store.runs()
        ]
    return folder / "plan.sqlite"


def packed(results: Path, count: int = 1) -> Path:
    """Pack a bundle of results."""
    path = results.with_suffix(".zip")
    with Store.open(results) as store:
        assert pack(store, path, count, overwrite=False).differing == ()
    return path


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Working directory in which a campaign with a policy was run."""
    folder = tmp_path_factory.mktemp("site")
    TRAIN["write_onnx"]((2.0, -0.4, -0.1), folder / "policy.onnx")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        results_of(folder, PLAN.format(name="policy", more="") + POLICY)
        yield folder


@pytest.fixture(scope="module")
def bundle(site: Path) -> Path:
    return packed(site / "plan.sqlite")


@pytest.mark.full
def test_policy_is_packed_under_its_hash(
    bundle: Path, site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = (site / "policy.onnx").read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    files = files_of(bundle)
    assert files[f"inputs/{digest}"] == content
    manifest = json.loads(files["manifest.json"])
    assert manifest["inputs"] == {"policy.onnx": digest}
    assert manifest["versions"]["onnxruntime"]
    with Store.open(site / "plan.sqlite") as store:
        (case,) = store.plan().cases
    assert json.loads(case.config)["controller"]["parameters"] == {"file": "policy.onnx", "sha256": digest}
    monkeypatch.chdir(tmp_path)  # where there is no policy
    ended = CliRunner().invoke(
        cli, ["campaign", "verify", str(bundle), "--seeds", "2"], catch_exceptions=False
    )
    assert ended.exit_code == 0, ended.output
    assert "2 runs of seeds 1, 2 repeated, 1 compared with their recordings" in ended.output
    monkeypatch.chdir(tmp_path)
    (tmp_path / "policy.onnx").write_bytes(b"another content")
    assert verify(bundle, 1).good


@pytest.mark.full
def test_altered_policy_byte_is_reported(bundle: Path, tmp_path: Path) -> None:
    """The report gives the name from the settings, even if the manifest has the hash of the altered file."""
    files = files_of(bundle)
    name = next(one for one in files if one.startswith("inputs/"))
    data = bytearray(files[name])
    data[-1] ^= 1
    for altered in ({**files, name: bytes(data)}, with_manifest({**files, name: bytes(data)})):
        path = repack(tmp_path / "altered.zip", altered)
        ended = CliRunner().invoke(cli, ["campaign", "verify", str(path)], catch_exceptions=False)
        assert ended.exit_code == 1
        assert f"altered: {name}, which the settings name policy.onnx\n" in ended.output
        assert ended.output.endswith("no run was repeated\n")


def test_replaced_policy_is_refused(bundle: Path, tmp_path: Path) -> None:
    """Every hash of the manifest matches, but the campaign was run with a different policy."""
    TRAIN["write_onnx"]((0.5, 0.0, 0.0), tmp_path / "other.onnx")
    content = (tmp_path / "other.onnx").read_bytes()
    digest = hashlib.sha256(content).hexdigest()
    files = {name: data for name, data in files_of(bundle).items() if not name.startswith("inputs/")}
    files = with_manifest({**files, f"inputs/{digest}": content}, inputs={"policy.onnx": digest})
    verified = verify(repack(tmp_path / "other.zip", files), None)
    (left,) = verified.not_repeated
    assert re.search(rf": controller\.parameters\.sha256 is not that of .*, which has {digest}$", left)
    assert not verified.good


def test_local_file_does_not_replace_missing_input(bundle: Path, site: Path, tmp_path: Path) -> None:
    files = {name: data for name, data in files_of(bundle).items() if not name.startswith("inputs/")}
    path = repack(tmp_path / "without.zip", with_manifest(files, inputs={}))
    assert (site / "policy.onnx").is_file()  # in the working directory
    verified = verify(path, 2)
    (left,) = verified.not_repeated
    assert (
        left == "not repeated, 2 runs of seeds 1, 2: policy.onnx is not in the bundle; get the bundle again"
    )
    assert (verified.runs, verified.good) == (0, False)
    assert verify(path, 0).good


def test_changed_policy_is_not_packed_and_changes_plan(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with Store.open(site / "plan.sqlite") as store:
        with pytest.raises(ConfigError, match=r"policy\.onnx: No such file.*, restore it$"):
            pack(store, tmp_path / "b.zip", 0, overwrite=False)
        TRAIN["write_onnx"]((0.5, 0.0, 0.0), tmp_path / "policy.onnx")
        packed = pack(store, tmp_path / "b.zip", 1, overwrite=False)
        assert (packed.sha256, len(packed.differing)) == ("", 1)
    with pytest.raises(ConfigError, match="contains another plan"):
        Store.begin(site / "plan.sqlite", read_plan(site / "plan.toml"))


@pytest.mark.full
def test_rules_height_map_and_drawn_policies_are_packed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rules.toml").write_text(rules_as_toml(PAPER_RULES))
    (tmp_path / "heights.txt").write_text("0 0\n0 0\n")
    TRAIN["write_onnx"]((2.0, -0.4, -0.1), tmp_path / "one.onnx")
    TRAIN["write_onnx"]((1.5, -0.4, -0.1), tmp_path / "two.onnx")
    fuzzy = """
        [config.controller]
        name = "fuzzy"
        parameters.rules_file = "rules.toml"
        [config.cell.surface]
        kind = "height_map"
        height_map_file = "heights.txt"
    """
    drawn = 'draw.controller.parameters.file = ["one.onnx", "two.onnx"]'
    policy = POLICY.replace("policy.onnx", "one.onnx")
    for name, more, section, expected in (
        ("fuzzy", "", dedent(fuzzy), {"rules.toml", "heights.txt"}),
        ("drawn", drawn, policy, {"one.onnx", "two.onnx"}),
    ):
        folder = tmp_path / name
        folder.mkdir()
        for path in tmp_path.glob("*.*"):
            (folder / path.name).write_bytes(path.read_bytes())
        monkeypatch.chdir(folder)
        file = packed(results_of(folder, PLAN.format(name=name, more=more) + section), 0)
        assert set(json.loads(files_of(file)["manifest.json"])["inputs"]) >= {*expected} - {"two.onnx"}
        monkeypatch.chdir("/")
        for path in folder.glob("*.*"):
            if path != file:
                path.unlink()
        verified = verify(file, 2)
        assert list(verified.lines)[-1] == "  identical to the last bit"
        assert (verified.runs, verified.good) == (2, True)


def test_plugin_controller_is_not_packed_but_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its file is executable code, whatever the name of its parameter."""
    package, info = tmp_path / "lab", tmp_path / "lab" / "steady_law-1.2.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: steady-law\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text("[hil_bridge.controllers]\nsteady = steady_law:Steady\n")
    (package / "steady_law.py").write_text(dedent(LAW))
    section = '[config.controller]\nname = "steady"\nparameters.file = "steady_law.py"\n'
    with monkeypatch.context() as patch:
        patch.syspath_prepend(str(package))
        path = packed(results_of(tmp_path, PLAN.format(name="steady", more="") + section), 0)
    sys.modules.pop("steady_law", None)
    files = files_of(path)
    assert not any(name.startswith("inputs/") or name.endswith(".py") for name in files)
    verified = verify(path, 2)
    (left,) = verified.not_repeated
    assert left.startswith(
        "not repeated, 2 runs of seeds 1, 2: controller.name: there is no controller 'steady'; "
    )
    assert "another version of steady-law: packed with 1.2, here none" in list(verified.lines)
    assert not verified.good
    assert "steady_law" not in sys.modules
