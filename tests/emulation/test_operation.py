"""Tests of an operator at the panels of the emulated EGM and RSI controllers, with clients of wire and web services."""

import math
from itertools import pairwise
from typing import Any

import pytest

from emulators.devices.egm import State
from emulators.devices.egm.operation import RefusedAct as EgmRefusal
from emulators.devices.egm.panel import EGM_CONTROLS
from emulators.devices.rsi import RsiProfile
from emulators.devices.rsi.correction import TOO_FAST
from emulators.devices.rsi.desk import RefusedAct as RsiRefusal
from emulators.devices.rsi.panel import RSI_CONTROLS
from emulators.devices.rsi.session import State as RsiState
from emulators.faults import Ledger
from emulators.panel import Panel
from protocol.devices.egm import Motors, PathCorrection, Rapid, SensorMessage
from protocol.devices.rsi import Telegram
from tests.emulation.egm_line import AT_ONCE, CYCLE, Line, planned, to
from tests.emulation.rsi_rig import PLAIN, QUICK, Rig, answer
from tests.emulation.test_egm_web_services import EXECUTION, MOTORS, Served

SPEED, MODE = "/rw/panel/speedratio", "/rw/panel/opmode"


def egm_panel(robot: Any) -> Panel:
    return Panel(robot, EGM_CONTROLS, Ledger({}))


def state_of(panel: Panel, name: str, to: object, now: float) -> dict[str, Any]:
    state: dict[str, Any] = panel.perform({"do": name, "to": to}, now)["state"]
    return state


# --- EGM: one state, two doors


def test_panel_and_web_services_agree() -> None:
    served = Served()
    panel = egm_panel(served.controller)
    state_of(panel, "motors", "off", served.now)
    assert (served.value(MOTORS, "ctrlstate"), served.value(EXECUTION, "ctrlexecstate")) == (
        "motoroff",
        "stopped",
    )
    assert served.status("POST", f"{MOTORS}?action=setctrlstate", "ctrl-state=motoron") == 204
    assert panel.show(served.now)["state"]["motors"] == "on"
    assert panel.show(served.now)["state"]["rapid"] == "stopped", "an operator or a client starts it"
    state_of(panel, "program", "start", served.now)
    assert served.value(EXECUTION, "ctrlexecstate") == "running"
    state_of(panel, "speed", "40", served.now)
    assert served.value(SPEED, "speedratio") == "40"
    assert served.status("POST", f"{SPEED}?action=setspeedratio", "speed-ratio=0") == 204
    assert panel.show(served.now)["state"]["speed_percent"] == 0


def test_manual_mode_makes_web_services_read_only() -> None:
    served = Served()
    panel = egm_panel(served.controller)
    state = state_of(panel, "key", "manual", served.now)
    assert (state["motors"], state["rapid"], served.value(MODE, "opmode")) == ("off", "stopped", "MANR")
    for target, body in (
        (f"{MOTORS}?action=setctrlstate", "ctrl-state=motoron"),
        (f"{EXECUTION}?action=start", ""),
        (f"{EXECUTION}?action=resetpp", ""),
        (f"{SPEED}?action=setspeedratio", "speed-ratio=50"),
    ):
        assert served.status("POST", target, body) == 403, target
    state_of(panel, "motors", "on", served.now)
    state_of(panel, "program", "start", served.now)
    served.run(0.1)
    assert served.state is State.GUIDING, "an operator with the enabling device lets it continue"
    state_of(panel, "key", "auto", served.now)
    assert served.status("POST", f"{MOTORS}?action=setctrlstate", "ctrl-state=motoron") == 204
    assert served.value(MODE, "opmode") == "AUTO"


def test_releasing_emergency_stop_starts_nothing() -> None:
    line = Line()
    panel = egm_panel(line.robot)
    line.streams(0.5, to(z=-5.0))
    state_of(panel, "emergency-stop", None, line.now)
    with pytest.raises(EgmRefusal, match=r"^an emergency stop is pressed$"):
        state_of(panel, "motors", "on", line.now)
    state_of(panel, "emergency-stop", "release", line.now)
    line.streams(0.5, to(z=-50.0))
    assert (line.last.motors, line.last.rapid) == (Motors.OFF, Rapid.STOPPED)
    assert len(set(line.z(100))) == 1, "it stands"
    with pytest.raises(EgmRefusal, match=r"^the motors are off$"):
        state_of(panel, "program", "start", line.now)
    state_of(panel, "motors", "on", line.now)
    line.streams(0.1, to(z=-50.0))
    assert (line.last.motors, line.last.rapid) == (Motors.ON, Rapid.STOPPED)
    start = line.z()
    state_of(panel, "program", "start", line.now)
    line.streams(0.5, to(z=-50.0))
    assert line.z() < start, "the guidance continues"


@pytest.mark.parametrize("mode", ["pose", "joint"])
def test_manual_mode_limits_speed_to_250_mm_s(mode: str) -> None:
    def fastest(key: str) -> float:
        line = Line(mode=mode, max_tcp_mm_s=1000.0, max_speed_dev_deg=120.0, **AT_ONCE)
        panel = egm_panel(line.robot)
        line.cycles(2)
        state_of(panel, "key", "manual", line.now)
        state_of(panel, "key", key, line.now)
        state_of(panel, "motors", "on", line.now)
        state_of(panel, "program", "start", line.now)
        assert line.last.feedback is not None
        joints = line.last.feedback.joints_deg
        far = to(y=300.0) if mode == "pose" else SensorMessage(0, 0, None, (joints[0] + 20.0, *joints[1:]))
        line.streams(0.3, far)
        places = [planned(message).position_mm for message in line.received]
        return max(math.dist(before, after) for before, after in pairwise(places)) / CYCLE

    assert fastest("manual") == pytest.approx(250.0, rel=1e-3)
    assert fastest("auto") > 500.0
    assert fastest("full-speed") == fastest("auto")


def test_speed_ratio_slows_programmed_path_only() -> None:
    def distance_moved(mode: str, percent: int) -> float:
        line = Line(mode=mode, **AT_ONCE)
        state_of(egm_panel(line.robot), "speed", percent, line.now)
        line.streams(1.0, PathCorrection(0, 0, (0.0, 0.0, 0.0), 0) if mode == "path" else to(x=10.0))
        assert line.last.planned is not None
        assert line.last.planned.pose is not None
        return line.last.planned.pose.position_mm[0] - 900.0

    assert distance_moved("path", 50) == pytest.approx(distance_moved("path", 100) / 2.0)
    assert distance_moved("path", 0) == 0.0
    assert distance_moved("pose", 0) == distance_moved("pose", 100) > 5.0


# --- RSI


class Kuka:
    """Controller that receives 0.01 mm per cycle, and its panel."""

    def __init__(self, **settings: Any) -> None:
        self.rig = Rig(RsiProfile(**{**QUICK, **settings}))
        self.panel = Panel(self.rig.robot, RSI_CONTROLS, Ledger({}))
        self.rig.run(20, z=-0.01)

    def do(self, name: str, to: object = None) -> dict[str, Any]:
        return state_of(self.panel, name, to, self.rig.now)

    def run(self, cycles: int = 20, z: float = -0.01) -> float:
        """Run this many answered cycles; return the growth of the correction, mm."""
        before = self.rig.z()
        self.rig.run(cycles, z=z)
        return before - self.rig.z()

    def last(self) -> Telegram:
        return self.rig.sent[-1]


def test_kuka_recovers_from_emergency_stop_step_by_step() -> None:
    kuka = Kuka(send=(*PLAIN, "ProgStatus.R"))
    assert kuka.run() == pytest.approx(0.2)
    kuka.do("emergency-stop")
    assert kuka.run() == 0.0
    assert kuka.last().values["ProgStatus.R"] == "4"
    for control, position, message in (
        ("drives", "on", "an emergency stop is pressed"),
        ("program", "start", "emergency stop"),
        ("program", "reset", "emergency stop"),
    ):
        with pytest.raises(RsiRefusal, match=f"^{message}$"):
            kuka.do(control, position)
    assert kuka.do("emergency-stop", "release")["hindrance"] == "the drives are off, telegrams continue"
    assert kuka.do("drives", "on")["hindrance"] == "the program is stopped, telegrams continue"
    assert kuka.run() == 0.0
    assert kuka.do("program", "start")["hindrance"] == ""
    assert kuka.run() == pytest.approx(0.2, abs=0.011)
    assert kuka.last().values["ProgStatus.R"] == "3"


@pytest.mark.parametrize("key", ["t1", "t2", "ext"])
def test_key_switch_turns_drives_off(key: str) -> None:
    kuka = Kuka()
    state = kuka.do("key", key)
    assert (state["key"], state["drives"], state["started"]) == (key, "off", False)
    assert kuka.run() == 0.0
    kuka.do("drives", "on")
    assert kuka.do("key", key)["drives"] == "on", "the same position again"


def test_t1_speed_above_250_mm_s_stops_by_correction() -> None:
    for key, error in (("aut", ""), ("t2", ""), ("t1", TOO_FAST)):
        kuka = Kuka(max_step_mm=3.0)
        if key != "aut":
            kuka.do("key", key)
            kuka.do("drives", "on")
            kuka.do("program", "start")
        kuka.run(5, z=-1.0)
        assert kuka.rig.robot.error == "", "1 mm in 4 ms are 250 mm/s"
        kuka.run(1, z=-1.1)
        for _ in range(5):
            kuka.rig.next()
        assert kuka.rig.robot.error == error, key


def test_t1_requires_confirmation_at_each_start() -> None:
    kuka = Kuka()
    with pytest.raises(RsiRefusal, match=r"^there is no message to confirm$"):
        kuka.do("message")
    kuka.do("key", "t1")
    kuka.do("drives", "on")
    assert kuka.do("program", "reset")["program"] == "ON"
    assert kuka.run() == 0.0
    state = kuka.panel.show(kuka.rig.now)["state"]
    assert state["to_confirm"]
    assert state["hindrance"] == "an operator has not confirmed the sensor correction, telegrams continue"
    kuka.do("message")
    assert kuka.run() > 0.15
    assert kuka.panel.show(kuka.rig.now)["state"]["program"] == "MOVECORR"


def test_override_is_reported_and_slows_no_correction() -> None:
    kuka = Kuka(send=(*PLAIN, "OvPro.R"))
    assert kuka.last().values["OvPro.R"] == "100"
    kuka.do("override", 0)
    assert kuka.run() == pytest.approx(0.2)
    assert kuka.last().values["OvPro.R"] == "0"


def test_program_ended_by_error_requires_operator_reset() -> None:
    kuka = Kuka(restart_s=1.0)
    kuka.run(1, z=-2.0)
    kuka.rig.next()
    assert kuka.rig.robot.state is RsiState.ERROR
    with pytest.raises(RsiRefusal, match=r"; reset the program$"):
        kuka.do("program", "start")
    kuka.do("drives", "off")
    for _ in range(300):
        kuka.rig.next()
    assert kuka.rig.robot.state is RsiState.ERROR, "no person resets it without drives"
    kuka.do("drives", "on")
    assert kuka.do("program", "reset")["program"] == "ON"
    kuka.rig.cycle(lambda ipoc: answer(ipoc, z=-0.01))
    assert kuka.run() > 0.15
