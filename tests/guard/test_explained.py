"""`config explain` answers as the control loop decides, and the table of conditions names all of it."""

import dataclasses
import math
from typing import Any

import pytest

from hil_bridge.control import Phase
from hil_bridge.control.course.verdict import WAITS
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.errors.cause_row import Reaction
from hil_bridge.errors.cause_table import ROWS
from hil_bridge.settings.configuration import read_config
from hil_bridge.site.guard.asking import LoopQuery, Situation
from hil_bridge.site.guard.explaining import explain

pytestmark = pytest.mark.sweep

CONFIG = read_config({})
RETRACT = Phase.RETRACT
APPROACH = Phase.APPROACH

STOPPING = [
    (Cause.FORCE_NOT_A_NUMBER, Situation(force_n=math.nan), ()),
    (Cause.ROBOT_STATE, Situation(fault="the sensor restarted"), ()),
    (Cause.FORCE, Situation(force_n=50.1), ("limits.force_limit_n",)),
    (Cause.FORCE, Situation(force_n=-50.1), ("limits.force_limit_n",)),
    (Cause.PULL, Situation(force_n=-10.1), ("limits.pull_limit_n",)),
    (Cause.FORCE, Situation(peak_n=50.1), ("limits.force_limit_n",)),
    (Cause.RESULTANT_FORCE, Situation(resultant_n=100.1), ("limits.resultant_limit_n",)),
    (Cause.MOMENT, Situation(moment_nm=10.1), ("limits.moment_limit_nm",)),
    (Cause.WALL, Situation(against_n=26.1), ("limits.against_travel_n",)),
    (Cause.SATURATED, Situation(saturated=True), ()),
    (Cause.FORCE_TOO_OLD, Situation(age_ms=200.1), ("limits.stale_after_ms",)),
    (Cause.SAME_COUNTS, Situation(unchanged_ms=4001.0), ("limits.frozen_after_ms",)),
    (Cause.NO_NEW_FRAME, Situation(still_ms=451.0), ("limits.still_after_ms",)),
    (Cause.DEAD_AXIS, Situation(dead_axis="Fz did not change"), ()),
    (Cause.UNANSWERED, Situation(unanswered_mm=2.1), ("limits.unanswered_mm",)),
    (Cause.LOST_WEIGHT, Situation(APPROACH, force_n=-1.1), ("limits.weight_tolerance_n",)),
    (
        Cause.UNCHANGED,
        Situation(APPROACH, unchanged_ms=201.0, unchanged_mm=1.1),
        ("limits.unchanged_mm", "limits.stale_after_ms"),
    ),
    (Cause.JUMP, Situation(moved_mm=12.7), ("robot.velocity_mm_s",)),
    (Cause.FOLLOWING, Situation(depth_mm=20.0, commanded_mm=9.9), ("limits.following_error_mm",)),
    (Cause.OFF_PATH, Situation(strayed_mm=0.5), ("limits.path_error_mm",)),
    (Cause.TILT, Situation(tilt_deg=2.1), ("limits.tilt_deg",)),
    (
        Cause.OUTSIDE,
        Situation(depth_mm=6.1, commanded_mm=0.0, start_m=(0.0, 0.0, -2.995)),
        ("limits.workspace_min_m",),
    ),
    (Cause.SEQUENCE, Situation(counter_back=1), ()),
    (Cause.DEADLINE, Situation(gap_ms=500.1), ("limits.cycle_deadline_ms",)),
    (Cause.CONTROLLER, Situation(controller_failure="it commands nan m"), ()),
    (Cause.OSCILLATION, Situation(swing_n=4.0), ()),
    (
        Cause.BEHIND,
        Situation(RETRACT, force_n=-10.1, retracting_ms=1000.0),
        ("limits.pull_limit_n",),
    ),
    (
        Cause.RETRACT_RISE,
        Situation(RETRACT, force_n=0.0, resultant_n=17.1, lowest_n=12.0, retracting_ms=1000.0),
        ("limits.retract_rise_n", "limits.retract_grace_ms"),
    ),
    (
        Cause.RETRACT_STAYS,
        Situation(RETRACT, force_n=0.0, resultant_n=110.0, retracting_ms=1000.0, back_mm=2.1),
        ("limits.resultant_limit_n", "limits.unanswered_mm"),
    ),
]
"""A case for each row of the supervisor's stops, with the settings that must be listed for it."""


OF_S3 = {Cause.ROBOT_STATE: ("robot.s3.link.check_flags",)}


@pytest.mark.parametrize(
    ("cause", "situation", "settings"),
    STOPPING,
    ids=[f"{cause}-{k}" for k, (cause, *_) in enumerate(STOPPING)],
)
def test_explained_condition_stops_for_its_cause(
    cause: Cause, situation: Situation, settings: tuple[str, ...]
) -> None:
    report = explain(CONFIG, situation)
    assert (report.verdict, report.cause) == ("stop", cause)
    (row,) = report.rows
    assert row is ROWS[cause]
    assert set(settings) <= set(row.settings)
    ruled = {setting.partition(" = ")[0] for setting in report.settings}
    assert ruled == set(settings or (*row.settings, *OF_S3.get(cause, ())))
    is_stationary = "stops" in report.then
    assert is_stationary == (row.reaction is Reaction.STANDS)


@pytest.mark.parametrize(
    "change",
    [
        {"phase": Phase.TRACK},
        {"force_n": -1.0, "unchanged_mm": 1.0},
        {"force_n": -1.1, "pulled_ms": 100.0, "unchanged_ms": 200.0},
    ],
)
def test_small_pull_in_free_space_is_allowed(change: dict[str, Any]) -> None:
    """In contact a pull is one, and a surface may move the tool."""
    calm = Situation(APPROACH, force_n=-1.1, pulled_ms=0.0, unchanged_ms=201.0, unchanged_mm=0.0)
    assert explain(CONFIG, dataclasses.replace(calm, **change)).verdict == "allow"


FEELING = read_config({"robot": {"emulated": "rtde"}, "sensor": {"emulated": "netft"}})
"""A robot that feels a force itself."""


def test_setting_of_other_robot_kind_has_no_effect() -> None:
    """The check of link flags applies only to an S3; this robot has no flags."""
    report = explain(FEELING, Situation(fault="the motors are off"))
    assert (report.cause, report.settings) == (Cause.ROBOT_STATE, ())
    assert "decided by     no setting" in list(report.lines())


@pytest.mark.parametrize(
    ("witness_n", "disagreed_ms", "verdict"),
    [
        (93.0, 120.0, "stop"),
        (93.0, 0.0, "allow"),
        (21.9, 1e4, "allow"),
        (22.1, 1e4, "stop"),
        (-2.1, 1e4, "stop"),
    ],
)
def test_lasting_witness_difference_stops(witness_n: float, disagreed_ms: float, verdict: str) -> None:
    """The sensor reports 10 N; a difference of 12 N is normal for this robot."""
    report = explain(FEELING, Situation(witness_n=witness_n, disagreed_ms=disagreed_ms))
    assert report.verdict == verdict
    if verdict == "stop":
        assert report.cause is Cause.WITNESS
        assert report.rows == (ROWS[Cause.WITNESS],)
        assert {setting.partition(" = ")[0] for setting in report.settings} == set(report.rows[0].settings)


def test_witness_margin_is_reported() -> None:
    (margin,) = (one for one in explain(FEELING, Situation(witness_n=14.0)).margins if one.name == "witness")
    assert (margin.value, margin.limit) == (4.0, pytest.approx(12.0))


@pytest.mark.parametrize(
    ("situation", "cause", "deepest_mm"),
    [
        (Situation(wanted_mm=4.1, commanded_mm=2.0), Cause.DEEPER, 3.98),
        (Situation(wanted_mm=101.0, commanded_mm=99.5, force_n=0.0), Cause.TOTAL, 100.0),
        # 45 N are free of the margin, 5 N of them are left: 0.25 mm of 20 kN/m
        (Situation(force_n=40.0, wanted_mm=12.0, commanded_mm=8.0, stiffness_n_m=2e4), Cause.BARRIER, 8.25),
        # an estimate below the expected stiffness does not count: 1 mm of 5 kN/m
        (Situation(force_n=40.0, wanted_mm=12.0, commanded_mm=8.0, stiffness_n_m=1e3), Cause.BARRIER, 9.0),
        (Situation(across_mm=5.1), Cause.ACROSS, 3.98),
        (Situation(wanted_mm=6.0, commanded_mm=4.5, start_m=(0.0, 0.0, -2.995)), Cause.WORKSPACE, 5.0),
    ],
)
def test_clamp_is_named_with_deepest_order(situation: Situation, cause: Cause, deepest_mm: float) -> None:
    report = explain(CONFIG, situation)
    assert (report.verdict, report.cause) == ("clamp", None)
    assert [row.cause for row in report.rows] == [cause]
    assert report.deepest_mm == pytest.approx(deepest_mm)
    assert {setting.partition(" = ")[0] for setting in report.settings} <= set(report.rows[0].settings)


@pytest.mark.parametrize(
    "situation",
    [
        Situation(RETRACT, force_n=17.1, lowest_n=12.0, retracting_ms=1000.0),
        Situation(RETRACT, force_n=60.0, retracting_ms=1000.0, back_mm=2.1),
    ],
)
def test_retraction_pauses_for_force_from_front(situation: Situation) -> None:
    report = explain(CONFIG, situation)
    assert (report.verdict, report.reasons) == ("clamp", (WAITS.text,))
    assert [row.cause for row in report.rows] == [Cause.RETRACT_WAITS]
    assert report.then.endswith("the run ends when it is back")


def test_held_approach_ends() -> None:
    report = explain(CONFIG, Situation(APPROACH, commanded_mm=100.0))
    assert report.verdict == "clamp"
    assert [row.cause for row in report.rows] == [Cause.TOTAL, "held-approach"]
    assert report.then.startswith("the tool retracts, now to 99 mm")


def test_uneventful_run_is_allowed_in_every_phase() -> None:
    for phase, then in (
        (APPROACH, "the tool moves deeper, to 0.5 mm"),
        (Phase.TRACK, "the tool stays at 2 mm"),
        (RETRACT, "the tool retracts, now to 1 mm; the run ends when it is back"),
    ):
        report = explain(CONFIG, Situation(phase))
        assert (report.verdict, report.rows, report.settings, report.then) == ("allow", (), (), then)


def test_margins_are_sorted_nearest_first() -> None:
    report = explain(CONFIG, Situation(force_n=40.0, age_ms=100.0, still_ms=150.0))
    margins = {margin.name: margin for margin in report.margins}
    assert [margin.name for margin in report.margins[:4]] == ["force", "age", "resultant", "still"]
    limits = CONFIG.limits
    for name, limit in (
        ("force", limits.force_limit_n),
        ("resultant", limits.resultant_limit_n),
        ("moment", limits.moment_limit_nm),
        ("age", limits.stale_after_ms),
        ("unchanged", limits.frozen_after_ms),
        ("still", limits.still_after_ms),
        ("unanswered", limits.unanswered_mm),
        ("following", limits.following_error_mm),
        ("tilt", limits.tilt_deg),
        ("gap", limits.cycle_deadline_ms),
    ):
        assert margins[name].limit == pytest.approx(limit, rel=1e-6), name
    assert margins["force"].text == "40 N, stops beyond 50 N: 10 left"
    assert margins["still"].text == "150 ms, stops beyond 450 ms: 300 left"


def test_margins_follow_the_configuration() -> None:
    config = read_config(
        {"limits": {"force_limit_n": 20.0, "stale_after_ms": 80.0}, "robot": {"velocity_mm_s": 100.0}}
    )
    before, after = (
        {margin.name: margin.limit for margin in explain(one, Situation(cycle_ms=100.0)).margins}
        for one in (CONFIG, config)
    )
    changed = {name for name in before if before[name] != pytest.approx(after[name])}
    assert changed == {"force", "age", "jump"}
    # Half again the velocity over the time between two answers, and 1 mm.
    assert after["jump"] == pytest.approx(1.5 * 100.0 * 0.1 + 1.0)


def test_explain_retraction_reports_force_rise_margin() -> None:
    report = explain(CONFIG, Situation(RETRACT, force_n=14.0, lowest_n=12.0, retracting_ms=1000.0))
    assert report.verdict == "allow"
    (margin,) = report.margins
    assert (margin.name, margin.value) == ("force", 14.0)
    assert margin.limit == pytest.approx(17.0)


def test_explained_start_outside_workspace_is_refused() -> None:
    with pytest.raises(ConfigError, match="outside the box"):
        explain(CONFIG, Situation(start_m=(5.0, 0.0, 0.0)))


def test_explained_loop_is_that_of_a_run() -> None:
    """An observation that no limit forbids goes through as it is, to the last bit."""
    decision = LoopQuery(CONFIG)(Situation(wanted_mm=2.5, commanded_mm=2.0))
    assert decision.verdict.kind == "allow"
    assert decision.target.depth == 2.5e-3


def test_explained_omits_settings_of_other_kinds() -> None:
    stopped = Situation(fault="the sensor restarted")
    of_s3 = explain(CONFIG, stopped).settings
    of_egm = explain(read_config({"robot": {"emulated": "egm"}}), stopped).settings
    assert [setting.partition(" = ")[0] for setting in of_s3] == [*OF_S3[Cause.ROBOT_STATE]]
    assert of_egm == ()
