"""Verdicts on evidence, without robot and client."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import pytest

from emulators.orders import Act, Hindrance, Reach, ReceivedOrder
from hil_bridge.errors import ConfigError
from hil_bridge.lab.conform.client import Where
from hil_bridge.lab.conform.reports import as_json, as_junit, lateness, not_modelled, table, totals
from hil_bridge.lab.conform.robots.judging import judge
from hil_bridge.lab.conform.robots.scenarios import Rules
from hil_bridge.lab.conform.robots.watching import RobotEvidence, ToolSample, Watch
from hil_bridge.lab.conform.rules import read_rules
from hil_bridge.lab.conform.trial import ScenarioResult
from hil_bridge.lab.conform.verdict import Outcome, Verdict
from protocol.geometry import Pose, turn_by
from protocol.unmodelled import NotModelled

RULES = Rules()
WELL = RobotEvidence(
    contact_at=0.1,
    orders=50,
    taken=50,
    first_order_at=0.2,
    moved_at=0.3,
    moved_m=0.01,
    exit_code=0,
    ended_at=2.0,
)
STOPPED = replace(WELL, fault_at=1.0, end_requested=True, exit_code=-15)


@pytest.mark.parametrize(
    ("scenario", "evidence", "message"),
    [
        ("nominal", replace(WELL, contact_at=None, moved_at=None, exit_code=1), "never connected: ended by"),
        ("nominal", replace(WELL, exit_code=3), "failed by itself: ended by itself after 2.0 s, exit code 3"),
        ("nominal", replace(WELL, exit_code=-11), "by SIGSEGV"),
        ("nominal", replace(WELL, unreadable=1, first_unreadable="a Q"), "sent unreadable data once"),
        ("nominal", replace(WELL, moved_at=None, orders=0), "it ordered no motion"),
        ("nominal", replace(WELL, moved_at=None), "none of its 50 orders moved the tool"),
        ("nominal", replace(WELL, hindrance="joint too fast"), "the robot stopped: joint too fast"),
        ("nominal", replace(WELL, left_m_s=0.02), "left the tool moving at 20.0 mm/s"),
        ("nominal", replace(WELL, killed=True, exit_code=None), "was killed"),
        ("nominal", replace(WELL, leaps=2, largest_step_m=0.3), "2 of its orders leap, by up to 300 mm"),
        ("late", replace(STOPPED, own_stop="too fast"), "its orders stopped the robot: too fast"),
        ("refused", replace(WELL, after_stop=7), "7 motion orders to a robot that could not move, after the"),
        ("refused", replace(WELL, moved_m=0.002), "the tool moved by 2.0 mm"),
        ("stopped", replace(STOPPED, after_stop=7, last_motion_s=1.9), "7 motion orders after the stop and the 500 ms"),
        ("stopped", replace(STOPPED, releases=["dashboard: play"]), "without an operator: dashboard: play"),
        ("emergency", replace(STOPPED, moved_after_m=0.001), "the tool moved by 1.0 mm after the stop"),
        ("refused", replace(WELL, moved_m=0.0, turned_rad=0.02), "the tool rotated by 1.1°"),
        ("stopped", replace(STOPPED, turned_after_rad=0.02), "the tool rotated by 1.1° after the stop"),
        ("cut", replace(STOPPED, own_stop="sudden"), "its orders stopped the robot: sudden"),
        ("cut", replace(STOPPED, end_requested=False, exit_code=-6), "crashed: ended by itself after 2.0 s"),
    ],
)  # fmt: skip
def test_judging_names_the_mistake(scenario: str, evidence: RobotEvidence, message: str) -> None:
    verdict = judge(scenario, evidence, RULES)
    assert verdict.outcome is Outcome.FAILED
    assert message in verdict.reason


@pytest.mark.parametrize("scenario", ["nominal", "late", "refused", "stopped", "emergency", "cut"])
def test_judging_passes_good_client(scenario: str) -> None:
    observed = (
        replace(WELL, moved_m=0.0) if scenario == "refused" else WELL if scenario == "nominal" else STOPPED
    )
    assert judge(scenario, observed, RULES).outcome is Outcome.PASSED


def test_judging_applies_user_rules_and_declarations() -> None:
    fast = replace(WELL, fastest_m_s=0.3, largest_step_m=0.002, end_requested=True)
    assert judge("nominal", fast, RULES).outcome is Outcome.PASSED
    assert "the tool moved at 300 mm/s" in judge("nominal", fast, Rules(max_speed_mm_s=250.0)).reason
    assert "a step of 2.00 mm" in judge("nominal", fast, Rules(max_step_mm=1.0)).reason
    assert "did not end by itself" in judge("nominal", fast, Rules(ends=True)).reason
    assert judge("cut", STOPPED, RULES).outcome is Outcome.PASSED
    assert "did not reconnect" in judge("cut", STOPPED, Rules(comes_back=True)).reason
    assert judge("cut", replace(STOPPED, back_at=3.0), Rules(comes_back=True)).outcome is Outcome.PASSED


def test_scenario_without_fault_is_skipped() -> None:
    verdict = judge("stopped", WELL, RULES)
    assert verdict == Verdict(
        Outcome.SKIPPED, "the client ended after 2.0 s, before the fault; let it move longer"
    )
    assert judge("stopped", replace(WELL, moved_at=None), RULES).outcome is Outcome.SKIPPED


@pytest.mark.parametrize("scenario", ["late", "stopped", "emergency", "cut"])
def test_client_failing_before_fault_is_not_skipped(scenario: str) -> None:
    """A skip would count as passed in pytest, so a client that does not even start would go unnoticed."""
    broken = replace(WELL, moved_at=None, orders=0, exit_code=1, ended_at=0.4)
    verdict = judge(scenario, broken, RULES)
    assert verdict.outcome is Outcome.FAILED
    assert verdict.reason == "failed by itself before the fault: ended by itself after 0.4 s, exit code 1"
    assert "by SIGSEGV" in judge(scenario, replace(broken, exit_code=-11), RULES).reason
    requested = replace(broken, refusals=["a variable"])
    assert judge(scenario, requested, RULES).outcome is Outcome.SKIPPED, (
        "a limitation of the emulator, not a mistake"
    )


# --- evidence


LEVEL = (1.0, 0.0, 0.0, 0.0)
REACH = Reach(0.004, 0.25, 1.0)
"""1 mm and 4 mrad per cycle."""


def order(
    at: float, z: float, *, is_accepted: bool = True, reach: Reach | None = None, turn: float = 0.0
) -> ReceivedOrder:
    pose = Pose((0.0, 0.0, z), turn_by((turn, 0.0, 0.0)))
    return ReceivedOrder(100.0 + at, Act.MOTION, "pose", is_accepted, pose, reach=reach)


def observe(
    watch: Watch, at: float, z: float = 0.0, speed: float = 0.0, hindrance: Hindrance | None = None
) -> None:
    watch.update(100.0 + at, ToolSample((0.0, 0.0, z), LEVEL, (0.0, 0.0, speed)), hindrance)


def watched(*, from_start: bool = False, stops: bool = True) -> Watch:
    watch = Watch(100.0, Rules(), stops=stops, from_start=from_start)
    observe(watch, 0.0)
    return watch


def test_hold_orders_are_not_motion() -> None:
    watch = watched()
    watch.receive(order(0.1, 0.001))
    watch.seen.fault_at = 1.0
    for k in range(10):
        watch.receive(order(2.0 + k, 0.001))
    assert watch.seen.after_stop == 0
    watch.receive(order(13.0, 0.002))
    assert watch.seen.after_stop == 1
    assert watch.seen.after_stop_step_m == pytest.approx(0.001)
    assert watch.seen.last_motion_s == pytest.approx(12.0)
    assert watch.seen.longest_pause_s == pytest.approx(2.0)


def test_orders_within_reaction_time_are_allowed() -> None:
    watch = watched()
    watch.seen.fault_at = 1.0
    watch.receive(order(1.4, 0.001))
    assert watch.seen.after_stop == 0
    watch.receive(order(1.6, 0.002))
    assert watch.seen.after_stop == 1


def test_speeds_and_unknown_programs_after_stop_are_motion() -> None:
    watch = watched()
    watch.seen.fault_at = 1.0
    for moves in (False, True):
        watch.receive(ReceivedOrder(102.0, Act.MOTION, "speedL", False, moves=moves))
        watch.receive(ReceivedOrder(102.0, Act.PROGRAM, "program x", False, moves=moves))
    assert watch.seen.after_stop == 2


def test_turning_tool_counts_as_motion() -> None:
    """A client that turns only the last joint moves no point on the tool's axis."""
    watch = watched()
    watch.update(100.1, ToolSample((0.0, 0.0, 0.0), turn_by((0.0, 0.0, 0.004)), (0.0, 0.0, 0.0)), None)
    assert watch.seen.moved_at is None
    watch.update(100.2, ToolSample((0.0, 0.0, 0.0), turn_by((0.0, 0.0, 0.006)), (0.0, 0.0, 0.0)), None)
    assert watch.seen.moved_at == pytest.approx(0.2)


def test_robot_stopped_from_start_allows_some_attempts() -> None:
    watch = watched(from_start=True)
    for at in (1.0, 1.2, 1.8):
        watch.receive(order(at, at, is_accepted=False))
    assert watch.seen.fault_at == pytest.approx(1.0)
    assert watch.seen.after_stop == 1
    watch.receive(order(3.0, 3.0, is_accepted=True))  # an operator has switched it on
    assert watch.seen.after_stop == 1


def test_judging_records_leaps_hindrances_and_releases() -> None:
    watch = watched()
    observe(watch, 0.1, hindrance=Hindrance("off", False))  # before the client connected
    watch.receive(order(0.2, 0.001, reach=REACH))
    watch.receive(order(0.3, 0.101, reach=REACH))
    observe(watch, 0.4, 0.003, 0.1)
    observe(watch, 0.5, 0.003, 0.1, Hindrance("sudden change", True))
    observe(watch, 0.6, 0.003, 0.1, Hindrance("off", False))
    observed = watch.seen
    assert (observed.leaps, observed.hindrance, observed.own_stop) == (1, "sudden change", "sudden change")
    assert observed.moved_at == pytest.approx(0.4)
    watch.receive(ReceivedOrder(100.7, Act.RELEASE, "unlock", True))
    assert observed.releases == []
    observed.fault_at = 0.6
    for number in range(20):
        watch.receive(ReceivedOrder(100.7, Act.RELEASE, f"unlock {number}", True))
    assert len(observed.releases) == 10


def test_robot_may_stop_after_client_ended() -> None:
    watch = watched()
    watch.receive(order(0.2, 0.001))
    watch.seen.end_requested = True
    observe(watch, 0.5, 0.003, 0.1, Hindrance("silence", False))
    assert watch.seen.hindrance == ""
    observe(watch, 0.6, 0.003, 0.1)
    observe(watch, 0.7, 0.003, 0.1, Hindrance("leap", True))
    assert watch.seen.own_stop == "leap"


# --- reports

RESULTS = [
    ScenarioResult("nominal", "nothing is wrong", Verdict(Outcome.PASSED, "moved"), WELL, "", 2.0),
    ScenarioResult(
        "stopped",
        "it stops",
        Verdict(Outcome.FAILED, "sent <7> & more"),
        STOPPED,
        "bad \x1b[2J\x00\nlines\n",
        3.0,
    ),
    ScenarioResult(
        "cut", "a cut", Verdict(Outcome.SKIPPED, "no"), RobotEvidence(moved_m=float("nan")), "", 0.0
    ),
]


def test_judging_reports_busy_computer() -> None:
    assert list(lateness(RESULTS)) == []
    late = [replace(RESULTS[0], seen=replace(WELL, late_s=0.208)), RESULTS[1]]
    (line,) = lateness(late)
    assert line.startswith(
        "this computer was too busy in nominal: hil-bridge was late by up to 208 ms, which may change a verdict"
    )


def test_verdict_contains_order_rate() -> None:
    observed = replace(WELL, first_order_at=1.0, last_order_at=1.5, orders=51)
    assert "in 51 orders, one every 10.0 ms, at most" in judge("nominal", observed, RULES).reason
    assert "in 50 orders, at most" in judge("nominal", WELL, RULES).reason


def test_junit_output_is_parsed_correctly() -> None:
    suite = ElementTree.fromstring(as_junit("rtde", RESULTS))[0]
    assert suite.attrib["tests"] == "3"
    assert (suite.attrib["failures"], suite.attrib["skipped"]) == ("1", "1")
    cases = {case.get("name"): case for case in suite}
    failure = cases["stopped"].find("failure")
    assert failure is not None
    assert failure.get("message") == "sent <7> & more"
    assert cases["stopped"].findtext("system-out") == "bad \ufffd[2J\ufffd\nlines\n"
    assert cases["cut"].find("skipped") is not None
    assert cases["nominal"].find("failure") is None


def test_json_and_table_agree() -> None:
    result = json.loads(as_json(("robot", "rtde"), ["./client"], RULES, RESULTS))
    assert [one["outcome"] for one in result["scenarios"]] == ["passed", "failed", "skipped"]
    assert result["scenarios"][1]["evidence"]["fault_at"] == 1.0
    assert result["scenarios"][2]["evidence"]["moved_m"] is None
    lines = list(table(RESULTS))
    assert lines[1].split(maxsplit=2) == ["stopped", "failed", "sent <7> & more"]
    assert "  bad \ufffd[2J\ufffd" in lines
    assert totals(RESULTS) == "1 passed, 1 failed, 1 skipped"


def test_every_report_lists_unmodelled_features() -> None:
    play, tool = (
        NotModelled("rtde", "URScript <rg_grip>()", "its program is not carried out"),
        NotModelled("rtde", "dashboard command load", "answered as not understood"),
    )
    results = [
        replace(RESULTS[0], not_modelled=(play, tool)),
        replace(RESULTS[1], not_modelled=(play,)),
        RESULTS[2],
    ]
    (line,) = not_modelled(results)
    assert line.startswith(
        "your client relied on 2 things that are not modelled: URScript <rg_grip>() (its program"
    )
    assert list(not_modelled(RESULTS)) == []
    result = json.loads(as_json(("robot", "rtde"), ["./client"], RULES, results))
    assert [len(one["not_modelled"]) for one in result["scenarios"]] == [2, 1, 0]
    assert result["scenarios"][1]["not_modelled"] == [
        {"device": "rtde", "thing": "URScript <rg_grip>()", "detail": "its program is not carried out"}
    ]
    case = ElementTree.fromstring(as_junit("rtde", results))[0][0]
    values = [one.get("value") for one in case.iter("property") if one.get("name") == "not_modelled"]
    assert values == [str(play), str(tool)]


def test_invalid_rule_and_placeholder_are_refused() -> None:
    assert read_rules(Rules, ["react_s=0.2"], ends=True) == Rules(react_s=0.2, ends=True)
    for wrong in ("react_s", "reacts=1", "react_s=x", "react_s=-1", "ends=1"):
        with pytest.raises(ConfigError, match="--set"):
            read_rules(Rules, [wrong])
    where = Where("rtde+tcp://h:1", {"host": "h", "port": "1"})
    assert where.filled(["x", "--to={host}:{port}", "{other}"]) == ["x", "--to=h:1", "{other}"]
    with pytest.raises(ConfigError, match="unknown placeholder"):
        where.filled(["{device}"])
    assert where.environment()["HIL_BRIDGE_HOST"] == "h"
