"""Policy as a controller: an object, or the path of an ONNX file."""

import hashlib
import math
import os
import pickle
import re
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from msgspec.structs import replace

import hil_bridge
import hil_bridge.gym
from hil_bridge.cli import cli
from hil_bridge.control import Measurement, make_controller
from hil_bridge.control.laws.policy import HIGH, LOW, OBSERVED, observe
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.gym import PolicyController
from hil_bridge.gym.follow import Options

ROOT = Path(__file__).resolve().parents[2]
FIGURES = ROOT / "docs" / "how-to" / "policies.json"
SHORT: dict[str, Any] = {"run": {"duration_s": 1.5}}
TRAIN = runpy.run_path(str(ROOT / "examples" / "policy" / "train.py"))
WEIGHTS = (2.0, -0.4, -0.1)


@pytest.fixture
def onnx_file(tmp_path: Path) -> Path:
    """File with the policy of the example."""
    path = tmp_path / "policy.onnx"
    TRAIN["write_onnx"](WEIGHTS, path)
    return path


def test_policy_file_replays_bit_by_bit(onnx_file: Path, tmp_path: Path) -> None:
    digest = hashlib.sha256(onnx_file.read_bytes()).hexdigest()
    section = {"name": "policy", "parameters": {"file": str(onnx_file), "sha256": digest}}
    result = hil_bridge.simulate({**SHORT, "controller": section})
    assert result.outcome == "completed"
    result.save(tmp_path / "run.mcap")
    replayed = CliRunner().invoke(cli, ["replay", str(tmp_path / "run.mcap")])
    assert replayed.exit_code == 0, replayed.output
    direct = hil_bridge.simulate(SHORT, controller=PolicyController(TRAIN["linear"](WEIGHTS)))
    ours, theirs = (
        [cycle.explanation["action_along"] for cycle in one.cycles if "action_along" in cycle.explanation]
        for one in (result, direct)
    )
    assert ours == pytest.approx(theirs, abs=1e-5)
    TRAIN["write_onnx"]((0.5, 0.0, 0.0), onnx_file)
    changed = CliRunner().invoke(cli, ["replay", str(tmp_path / "run.mcap")])
    assert isinstance(changed.exception, ConfigError)
    assert "is not that of" in str(changed.exception)


def test_policy_file_path_is_relative_to_configuration(onnx_file: Path, tmp_path: Path) -> None:
    text = '[controller]\nname = "policy"\n[controller.parameters]\nfile = "policy.onnx"\n'
    (tmp_path / "policy.toml").write_text(text)
    config = hil_bridge.load(tmp_path / "policy.toml")
    assert config.controller.parameters["file"] == str(onnx_file)


def test_policy_file_works_in_process_pool(onnx_file: Path) -> None:
    controller = make_controller("policy", file=str(onnx_file))
    again = pickle.loads(pickle.dumps(controller))
    assert again == controller
    measurement = Measurement(0.0, 5.0, 1e-3, 1e-3)
    assert controller.step(controller.initial(), measurement, 10.0) == again.step(
        again.initial(), measurement, 10.0
    )


@pytest.mark.parametrize("content", [b"", b"no onnx", bytes(5000), b"\x08\x07\x12\x04" * 40])
def test_damaged_policy_file_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "damaged.onnx"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as raised:
        make_controller("policy", file=str(path))
    assert "damaged.onnx is not an ONNX policy from" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_non_regular_results_file_is_refused(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "policy.onnx"
    if kind == "pipe":
        os.mkfifo(path)
    with pytest.raises(ConfigError, match=f"it is a {kind}, not a regular file"):
        make_controller("policy", file=str(path if kind == "pipe" else "/dev/zero"))


def test_results_file_with_endless_view_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    onnx = pytest.importorskip("onnx")
    monkeypatch.setattr("hil_bridge.control.laws.policy.TRIAL_S", 0.2)
    make, number = onnx.helper, onnx.TensorProto
    value = make.make_tensor_value_info
    body = make.make_graph(
        [
            make.make_node("Identity", ["go"], ["on"]),
            make.make_node("Tanh", ["before"], ["after"]),
        ],
        "body",
        [
            value("k", number.INT64, []),
            value("go", number.BOOL, []),
            value("before", number.FLOAT, [1, len(OBSERVED)]),
        ],
        [value("on", number.BOOL, []), value("after", number.FLOAT, [1, len(OBSERVED)])],
    )
    graph = make.make_graph(
        [make.make_node("Loop", ["times", "", "seen"], ["action"], body=body)],
        "policy",
        [value("seen", number.FLOAT, [1, len(OBSERVED)])],
        [value("action", number.FLOAT, [1, len(OBSERVED)])],
        [make.make_tensor("times", number.INT64, [], [1 << 40])],
    )
    path = tmp_path / "loop.onnx"
    model = make.make_model(graph, opset_imports=[make.make_opsetid("", 17)], ir_version=8)
    path.write_bytes(model.SerializeToString())
    with pytest.raises(ConfigError, match=r"it did not answer within 0\.2 s"):
        make_controller("policy", file=str(path))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({}, "must be the path of an ONNX file"),
        ({"file": "/nowhere/policy.onnx"}, "cannot read /nowhere/policy.onnx"),
        ({"file": "x", "speed_mm_s": 0.0}, "must be above 0"),
    ],
)
def test_invalid_policy_setting_is_refused(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        hil_bridge.simulate({"controller": {"name": "policy", "parameters": parameters}})


@pytest.mark.parametrize("action", [[1.0, 2.0], [math.nan], "no", None])
def test_invalid_policy_action_stops_run(action: Any) -> None:
    result = hil_bridge.simulate(SHORT, controller=PolicyController(lambda observation: action))
    assert result.cause is Cause.CONTROLLER
    assert result.retracted


def test_action_out_of_range_is_clipped() -> None:
    controller = PolicyController(lambda observation: [9.0, -9.0], ("along", "across"), 5.0)
    measurement = Measurement(0.0, 5.0, 1e-3, 2e-3, dt=0.1)
    state, command = controller.step(controller.initial(), measurement, 10.0)
    assert state.force == 5.0
    assert command.position == pytest.approx(2e-3 + 5e-4)
    assert command.across == pytest.approx(-5e-4)
    unknown = Measurement(0.0, math.nan, 1e-3, 2e-3)
    assert controller.step(state, unknown, 10.0)[1].correction == 0.0


@pytest.mark.parametrize("speed_mm_s", [60.0, 1e12])
def test_lateral_command_is_limited_to_travel_speed(speed_mm_s: float) -> None:
    """An excessive command would move the tool laterally during the retraction."""
    policy = PolicyController(lambda observation: [0.0, 1.0], ("along", "across"), speed_mm_s)
    result = hil_bridge.simulate({**SHORT, "robot": {"velocity_mm_s": 80.0}}, controller=policy, seed=2)
    aside = [cycle.across_commanded for cycle in result.cycles]
    times = [cycle.started_at for cycle in result.cycles]
    assert aside[-1] > 1e-3
    for k in range(1, len(aside)):
        assert abs(aside[k] - aside[k - 1]) <= 5.5e-3 * 2.0 * (times[k] - times[k - 1]) + 1e-9
    ends = [cycle.across_commanded for cycle in result.cycles if cycle.phase == "retract"]
    assert len(set(ends)) == 1, "the retraction goes straight back"


@pytest.mark.parametrize("aside", [math.inf, math.nan])
def test_non_numeric_lateral_command_fails_controller(aside: float) -> None:
    class Lost(PolicyController):
        def step(self, state, measurement, reference):
            memory, command = super().step(state, measurement, reference)
            return memory, replace(command, across=aside)

    result = hil_bridge.simulate(SHORT, controller=Lost(lambda observation: [0.0]), seed=2)
    assert result.cause is Cause.CONTROLLER
    assert f"{aside} m sideways" in result.text
    assert all(math.isfinite(cycle.across_commanded) for cycle in result.cycles)
    assert result.retracted


def test_observation_stays_in_space() -> None:
    wild = Measurement(0.0, 1e30, math.nan, -1e30, dt=1e9)
    observed = observe(wild, 10.0, -1e30)
    assert observed.shape == (len(OBSERVED),)
    assert observed.dtype == np.float32
    assert (observed >= LOW).all()
    assert (observed <= HIGH).all()


@pytest.mark.parametrize("name", ["how-to/policies.md", "reference/gym.md"])
def test_documented_example_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs" / name).read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert blocks
    monkeypatch.chdir(tmp_path)
    for block in blocks:
        exec(compile(block, name, "exec"), {"__name__": "example"})


def test_gym_page_lists_all_names_and_arguments() -> None:
    page = (ROOT / "docs" / "reference" / "gym.md").read_text(encoding="utf-8")
    names = {*hil_bridge.gym.__all__, *hil_bridge.gym.REWARDS, *Options.__annotations__}
    assert all(f"`{name}`" in page for name in names)
