"""Names that faults had before: each is answered with the one that it has now, wherever a person writes it."""

import tomllib
from pathlib import Path

import pytest

from emulators.devices.s3.faults import S3_FAULTS
from emulators.faults import find, target_of
from emulators.faults.renamed import RENAMED, RENAMED_PARAMETERS, tell_new_name
from hil_bridge.devices.kinds import ROBOTS, SENSORS, EmulatedKinds, fault_targets
from hil_bridge.errors import ConfigError
from hil_bridge.lab.campaign.plan_file import read_plan
from hil_bridge.settings.configuration import read_config

CELLS = [
    EmulatedKinds.named(robot, sensor) for robot in ROBOTS.built_in for sensor in ("jr3", *SENSORS.built_in)
]


@pytest.mark.parametrize(("on", "fault"), RENAMED)
def test_an_old_name_is_answered_with_a_name_that_some_cell_has(on: str, fault: str) -> None:
    names = RENAMED[on, fault]
    for name in names:
        able = [cell for cell in CELLS if name.fault in cell.faults.get(name.target, {})]
        assert able, f"no cell has {name}"
        keys, _, rest = name.given.partition("with = ")
        given = tomllib.loads(keys.rstrip(", ")) | tomllib.loads(f"with = {rest or '{}'}")["with"]
        find(able[0].faults, name.target, name.fault).values(name.fault, given)
    for cell in CELLS:
        assert fault not in cell.faults.get(on, {}), "an old name is no fault any more"
        with pytest.raises(ValueError, match=f"^{on}: {fault} is called ") as refused:
            find(cell.faults, on, fault)
        assert "\n" not in str(refused.value)
        there = [name for name in names if name.fault in cell.faults.get(name.target, {})]
        assert str(refused.value).endswith(f"is called {(there or names)[0]} now")
    with pytest.raises(ValueError, match=f"{on}: {fault} is called {names[0].target}: {names[0].fault}"):
        read_config({"faults": [{"on": on, "fault": fault}]})
    assert on in fault_targets()


def test_an_old_name_alone_is_answered_at_the_panel() -> None:
    known = {fault for faults in S3_FAULTS.values() for fault in faults}
    for on, fault in RENAMED:
        if fault not in known:
            with pytest.raises(ValueError, match=f"^[a-z]+: {fault} is called [^\n]+ now$"):
                target_of(fault, S3_FAULTS)
        assert tell_new_name(on, fault, {})


def test_an_old_target_is_answered_whatever_its_fault() -> None:
    with pytest.raises(ValueError, match=r"^the faults of frames are those of sensor-wire and sensor now$"):
        find(CELLS[0].faults, "frames", "new")
    with pytest.raises(ValueError, match=r"^no target is called 'cable'; known: robot, pose, wire, "):
        find(CELLS[0].faults, "cable", "off")


@pytest.mark.parametrize(("on", "fault", "says"), [
    ("link", "delay", "link: delay is called wire: late now"),
    ("frames", "*", "the faults of frames are those of sensor-wire and sensor now"),
])  # fmt: skip
def test_a_campaign_that_draws_faults_answers_old_names_too(
    on: str, fault: str, says: str, tmp_path: Path
) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(
        f'[campaign]\nseeds = [1]\nfaults_per_run = 1\n[[campaign.fault]]\non = "{on}"\nfault = "{fault}"\n'
        '[campaign.criteria]\noutcome = ["completed"]\n'
    )
    with pytest.raises(ConfigError, match=says):
        read_plan(plan)


@pytest.mark.parametrize(("fault", "parameter"), RENAMED_PARAMETERS)
def test_a_parameter_that_is_gone_is_answered_with_what_does_its_work(fault: str, parameter: str) -> None:
    with pytest.raises(
        ValueError,
        match=rf"no parameter '{parameter}'; known: [^\n]+; {RENAMED_PARAMETERS[fault, parameter]}$",
    ):
        find(CELLS[0].faults, "wire", fault).values(fault, {parameter: "to"})
