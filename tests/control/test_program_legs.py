"""Preparation of a program: its steps in a row, and the refusals, each with the step's number."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control import FuzzyPi, Stroke, TaskParameters
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.geometry.ways import way_of
from hil_bridge.control.program.legs import LEGS_MAX, Ground, legs_of, seconds
from hil_bridge.control.program.resume import rest_of, resume_row
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.hold import Hold
from hil_bridge.control.steps.move import Move
from hil_bridge.control.steps.paths import Line, Polyline, Raster
from hil_bridge.control.steps.repeat import Repeat
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import Criterion, StepLimits
from hil_bridge.control.steps.seek import Seek
from hil_bridge.control.steps.settings import ResumePoint
from hil_bridge.control.steps.track import Track
from hil_bridge.control.steps.zero import Zero
from hil_bridge.errors import ConfigError

LINE = Line(length_mm=10.0)
ROBOT_MM_S = 50.0


def row_of(*steps, origin_known=False, limits=None, **parameters):
    limits = limits or Limits()
    stroke = Stroke(TaskParameters(**parameters), FuzzyPi(), limits.force_limit_n, 0.125e-3)
    return legs_of(steps, Ground(stroke, limits, ROBOT_MM_S, origin_known))


def refused(*steps, **settings):
    """Return the one-line refusal."""
    with pytest.raises(ConfigError) as reported:
        row_of(*steps, **settings)
    assert "\n" not in str(reported.value)
    return str(reported.value)


# --- the row


def test_leg_knows_whether_tool_may_touch_side():
    """A step that works aside hands that on until the tool has lifted; a move before a touch hands nothing on."""
    side = Track(path=LINE, across="force", across_n=5.0)
    steps = (
        Move(to_mm=(0.0, 0.0)),
        Approach(),
        side,
        Hold(for_s=1.0),
        Retract(),
        Approach(),
        Hold(for_s=1.0),
        Retract(),
    )
    assert [leg.works_aside for leg in row_of(*steps).legs] == [
        True,
        False,
        True,
        True,
        True,
        False,
        False,
        False,
    ]
    met = Seek(direction_deg=0.0), Retract(), Approach(), Retract()
    assert [leg.works_aside for leg in row_of(*met).legs] == [True, True, False, False]


@pytest.mark.parametrize("limit", [2.0, 40.0])
def test_resumed_program_moves_within_step_limits(limit):
    track = Track(path=LINE, speed_mm_s=1.0, limits=StepLimits(travel_mm_s=limit))
    stroke = Stroke(TaskParameters(), FuzzyPi(), 50.0)
    row = legs_of((Approach(), track, Retract()), Ground(stroke, Limits(travel_mm_s=50.0)))
    point = ResumePoint(1, 4.0, (4.0, 0.0), (0.9, 0.0, 0.6), (0.0, 1.0, 0.0, 0.0))
    move = resume_row(row, point, stroke).legs[0].step
    assert (move.do, move.speed_mm_s) == ("move", min(limit, 10.0))


def test_rest_of_path_ends_at_same_point():
    path = way_of(((0.0, 0.0), (10.0, 0.0), (10.0, 5.0), (0.0, 5.0)))
    for done in (0.0, 4e-3, 12e-3, 20e-3):
        rest, (x, y) = rest_of(path, done), path.at(done)
        assert rest.length == pytest.approx(path.length - done)
        for on in (0.0, 1e-3, 3e-3, rest.length):
            u, v = rest.at(on)
            assert (x + u, y + v) == pytest.approx(path.at(done + on), abs=1e-12)
            assert rest.headings[rest.piece(on)] == path.headings[path.piece(done + on)]


def test_approach_reach_includes_previous_retraction():
    """A bound set by the operator is kept."""
    row = row_of(
        Approach(),
        Retract(back_mm=6.0),
        Approach(),
        Retract(back_mm=6.0),
        Approach(at_most_mm=7.0),
        Retract(),
    )
    limits = [leg.stroke.parameters.approach_depth_limit_mm for leg in row.legs[::2]]
    assert limits == [15.0, 21.0, 7.0]


def test_leg_uses_task_parameters_by_default():
    row = row_of(
        Approach(speed_mm_s=1.0, contact_n=2.0, at_most_mm=7.0),
        Track(path=LINE, speed_mm_s=3.0, force_n=12.0),
        Track(path=LINE),
        Hold(for_s=2.0, force_n=4.0),
        Retract(back_mm=6.0, speed_mm_s=4.0),
    )
    approach, track, plain, hold, retract = (leg.stroke.parameters for leg in row.legs)
    assert (approach.approach_speed_mm_s, approach.contact_threshold_n) == (1.0, 2.0)
    assert approach.approach_depth_limit_mm == 7.0
    assert (track.speed_mm_s, track.force_n) == (3.0, 12.0)
    assert (plain.speed_mm_s, plain.force_n) == (TaskParameters().speed_mm_s, TaskParameters().force_n)
    assert (hold.speed_mm_s, hold.force_n) == (0.0, 4.0)
    assert (retract.retract_mm, retract.retract_speed_mm_s) == (6.0, 4.0)


def test_leg_loss_threshold_follows_contact_force():
    row = row_of(Approach(contact_n=0.3), Retract())
    assert row.legs[0].stroke.parameters.loss_threshold_n == 0.3


def test_leg_labels_start_at_1():
    row = row_of(
        Approach(),
        Track(path=LINE),
        Retract(),
        Repeat(times=2, step=(Move(to_mm=(0.0, 0.0)), Zero())),
        Retract(),
    )
    assert [leg.label for leg in row.legs] == [
        "1 (approach)",
        "2 (track)",
        "3 (retract)",
        "4.1 (move, pass 1)",
        "4.2 (zero, pass 1)",
        "4.1 (move, pass 2)",
        "4.2 (zero, pass 2)",
        "5 (retract)",
    ]


def test_last_leg_of_pass_knows_end_of_repeat():
    stroke = (Approach(), Track(path=LINE), Retract(), Move(to_mm=(0.0, 0.0)))
    row = row_of(Retract(), Repeat(times=3, step=stroke, until_removed_mm=0.2), Retract())
    assert [leg.repeat.leave_to for leg in row.legs] == [None, *[None, None, None, 13] * 3, None]
    assert [leg.repeat.is_first for leg in row.legs] == [False, True, *[False] * 12]
    assert {leg.repeat.removed for leg in row.legs[1:13]} == {0.2e-3}


def test_leg_places_follow_paths():
    row = row_of(
        Approach(),
        Track(path=Line(length_mm=10.0, direction_deg=90.0)),
        Track(path=Line(to_mm=(5.0, 10.0))),
        Retract(),
        Move(to_mm=(1.0, 2.0)),
        Seek(direction_deg=0.0),
        Retract(),
    )
    assert row.places[:5] == (
        (0.0, 0.0),
        (0.0, 0.0),
        pytest.approx((0.0, 10.0)),
        pytest.approx((5.0, 10.0)),
        pytest.approx((5.0, 10.0)),
    )
    assert row.places[5:] == ((1.0, 2.0), None)


@pytest.mark.parametrize("track", [Track(path=LINE, for_s=1.0), Track(path=LINE, across="compliant")])
def test_leg_end_of_timed_track_is_unknown(track):
    row = row_of(Approach(), track, Retract())
    assert row.places == ((0.0, 0.0), (0.0, 0.0), None)


# --- profiles


def test_force_profile_is_linear_between_pairs():
    row = row_of(Approach(), Track(path=LINE, force_n=((0.0, 4.0), (5.0, 14.0), (10.0, 9.0))), Retract())
    track = row.legs[1]
    expected = [track.reference(mm * 1e-3) for mm in (-1.0, 0.0, 2.5, 5.0, 7.5, 10.0, 11.0)]
    assert expected == pytest.approx([4.0, 4.0, 9.0, 14.0, 11.5, 9.0, 9.0])
    assert track.stroke.parameters.force_n == 14.0


PAIRS = st.lists(
    st.tuples(st.floats(0.1, 50.0), st.floats(2.0, 40.0)),
    min_size=1,
    max_size=6,
    unique_by=lambda pair: pair[0],
).map(lambda pairs: ((0.0, 10.0), *sorted(pairs)))


@given(PAIRS, st.floats(0.0, 60.0))
def test_force_profile_stays_within_its_pairs(pairs, mm):
    row = row_of(Approach(), Track(path=Line(length_mm=pairs[-1][0]), force_n=pairs), Retract())
    forces = [force for _, force in pairs]
    assert min(forces) - 1e-9 <= row.legs[1].reference(mm * 1e-3) <= max(forces) + 1e-9
    for at, force in pairs:
        assert row.legs[1].reference(at * 1e-3) == pytest.approx(force)


def test_force_profile_shorter_than_path_is_refused():
    message = refused(Approach(), Track(path=LINE, force_n=((0.0, 5.0), (8.0, 9.0))), Retract())
    assert message == (
        "task.step 2 (track): force_n ends at 8 mm, but the path is 10.0 mm long: give the force of its end"
    )


@pytest.mark.parametrize(
    ("force", "message"),
    [
        (((1.0, 5.0), (8.0, 9.0)), "force_n must begin at 0 mm of the path"),
        ((), "force_n must begin at 0 mm of the path"),
        (((0.0, 5.0), (8.0, 9.0), (8.0, 7.0)), "force_n must ascend along the path, but 8 mm follows 8 mm"),
        (((0.0, 5.0), (8.0, 0.0)), "force_n must be above 0 N everywhere, got 0"),
        (-3.0, "force_n must be above 0 N everywhere, got -3"),
        (math.nan, "force_n must be above 0 N everywhere, got nan"),
    ],
)
def test_force_profile_with_gap_or_pull_is_refused(force, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Track(path=LINE, force_n=force)


def test_leg_force_below_contact_threshold_is_refused():
    message = refused(Approach(), Track(path=LINE, force_n=((0.0, 5.0), (10.0, 0.8))), Retract())
    assert message == (
        "task.step 2 (track): force_n of 0.8 N must be above task.contact_threshold_n of 1 N: "
        "with less, the tool is not in contact"
    )


# --- limits


def test_step_limit_may_be_stricter_than_run():
    own = StepLimits(force_limit_n=20.0, turn_deg_s=3.0)
    row = row_of(Approach(limits=own), Retract())
    assert (row.legs[0].limits.force_limit_n, row.legs[0].limits.turn_deg_s) == (20.0, 3.0)
    assert row.legs[0].stroke.force_limit_n == 20.0
    assert row.legs[1].limits == Limits()


@pytest.mark.parametrize("name", list(StepLimits.__slots__))
def test_step_limit_looser_than_run_is_refused(name):
    most = getattr(Limits(), name)
    message = refused(Approach(), Retract(limits=StepLimits(**{name: most + 1.0})))
    assert message == (
        f"task.step 2 (retract): limits.{name} of {most + 1:g} exceeds that of the run, {most:g}: "
        "a step can only tighten a limit"
    )


@pytest.mark.parametrize("name", list(StepLimits.__slots__))
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_step_limit_of_zero_is_refused(name, value):
    with pytest.raises(ValueError, match=name):
        StepLimits(**{name: value})


def test_leg_force_at_its_limit_is_refused():
    message = refused(
        Approach(), Track(path=LINE, force_n=30.0, limits=StepLimits(force_limit_n=30.0)), Retract()
    )
    assert message == "task.step 2 (track): force_n of 30 N must be below its force limit of 30 N"


@pytest.mark.parametrize(
    ("sine_n", "message"),
    [
        (9.0, "force_n of 10 N with a sine of 9 N must be above task.contact_threshold_n of 1 N: "),
        (5.0, "force_n of 10 N with a sine of 5 N must be below its force limit of 15 N"),
    ],
)
def test_sine_beyond_allowed_forces_is_refused(sine_n, message):
    hold = Hold(for_s=1.0, force_n=10.0, sine_n=sine_n, sine_hz=1.0, limits=StepLimits(force_limit_n=15.0))
    assert message in refused(Approach(), hold, Retract())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"sine_n": 2.0}, "sine_hz must be above 0 if sine_n is set"),
        ({"sine_hz": 2.0}, "sine_n must be above 0 if sine_hz is set"),
        ({"sine_n": -1.0, "sine_hz": 1.0}, "sine_n must be a number of at least 0, got -1"),
        ({"sine_n": 1.0, "sine_hz": math.inf}, "sine_hz must be a number of at least 0, got inf"),
    ],
)
def test_invalid_sine_of_hold_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Hold(for_s=1.0, **settings)


def test_free_step_may_have_lower_force_limit():
    tight = StepLimits(force_limit_n=5.0)
    row = row_of(Zero(limits=tight), Move(to_mm=(1.0, 1.0), limits=tight), Retract(limits=tight))
    assert [leg.limits.force_limit_n for leg in row.legs] == [5.0, 5.0, 5.0]


def test_contact_force_above_desired_is_refused():
    message = refused(Approach(contact_n=10.0), Retract())
    assert message == "task.step 1 (approach): contact_n of 10 N must be below task.force_n of 10 N"


# --- order of steps


@pytest.mark.parametrize("step", [Track(path=LINE), Hold(for_s=1.0)])
def test_pressing_step_needs_an_approach(step):
    message = refused(step, Retract())
    assert message.startswith(f"task.step 1 ({step.do}): ")
    assert message.endswith("the tool does not press here: insert an approach before")


def test_seek_edge_needs_contact():
    message = refused(Seek(direction_deg=0.0, until="edge"), Retract())
    assert message == "task.step 1 (seek): an edge is searched for while pressing: insert an approach before"


@pytest.mark.parametrize(
    "step", [Move(to_mm=(1.0, 1.0)), Zero(), Seek(direction_deg=0.0), Approach()], ids=lambda step: step.do
)
@pytest.mark.parametrize(
    "before",
    [(Approach(),), (Approach(), Hold(for_s=1.0)), (Approach(), Seek(direction_deg=0.0, until="edge"))],
    ids=("approach", "hold", "edge"),
)
def test_free_step_needs_a_retract(before, step):
    message = refused(*before, step, Retract())
    number = len(before) + 1
    assert message == f"task.step {number} ({step.do}): the tool presses here: insert a retract before"


def test_step_label_in_repeat_contains_pass():
    message = refused(Repeat(times=2, step=(Approach(), Track(path=LINE))), Retract())
    assert message == "task.step 1.1 (approach, pass 2): the tool presses here: insert a retract before"


@pytest.mark.parametrize("steps", [(), (Approach(),), (Approach(), Hold(for_s=1.0))])
def test_program_ending_in_contact_is_refused(steps):
    assert refused(*steps) == (
        "task.step: the last step must be a retract, because a program must not end in contact"
    )


def test_path_not_at_tool_is_refused():
    path = Polyline(points_mm=((1.0, 0.0), (5.0, 0.0)))
    message = refused(Approach(), Track(path=path), Retract())
    assert message == (
        "task.step 2 (track): the path begins at 1, 0 mm, but the tool is at 0, 0 mm: insert a move before"
    )


@pytest.mark.parametrize("path", [Raster(size_mm=(5.0, 5.0)), Polyline(points_mm=((0.0, 0.0), (5.0, 0.0)))])
def test_path_from_unknown_position_is_refused(path):
    message = refused(Approach(), Track(path=path), Retract(), origin_known=True)
    assert message == (
        "task.step 2 (track): the path begins at 0, 0 mm, but the tool's position is not known here: "
        "insert a move before"
    )
    row_of(Move(to_mm=(0.0, 0.0)), Approach(), Track(path=path), Retract(), origin_known=True)


def test_line_from_unknown_position_is_refused():
    message = refused(Approach(), Track(path=Line(to_mm=(1.0, 1.0))), Retract(), origin_known=True)
    assert message.startswith("task.step 2 (track): where the path begins is not known")


def test_program_with_too_many_steps_is_refused():
    passes = Repeat(times=1000, step=(Zero(),) * 6)
    assert refused(passes, Retract()) == (
        f"task.step: more than {LEGS_MAX} steps, with the passes of a repeat"
    )


# --- speeds


@pytest.mark.parametrize(
    "step",
    [Approach(speed_mm_s=51.0), Move(to_mm=(1.0, 1.0), speed_mm_s=51.0), Retract(speed_mm_s=51.0)],
    ids=lambda step: step.do,
)
def test_leg_speed_above_robot_is_refused(step):
    assert refused(step, Retract()) == (
        f"task.step 1 ({step.do}): speed_mm_s of 51 is faster than the robot's path velocity: lower it, or set "
        "robot.velocity_mm_s, now 50"
    )


def test_leg_speed_above_travel_limit_is_refused():
    message = refused(Approach(), Track(path=LINE, speed_mm_s=30.0), Retract())
    assert message == "task.step 2 (track): speed_mm_s of 30 is above limits.travel_mm_s of 27.5"
    own = StepLimits(travel_mm_s=4.0)
    message = refused(Move(to_mm=(1.0, 1.0), speed_mm_s=5.0, limits=own), Retract())
    assert message == "task.step 1 (move): speed_mm_s of 5 is above limits.travel_mm_s of 4"


def test_approach_speed_above_limit_is_refused():
    message = refused(Approach(speed_mm_s=12.0), Retract())
    assert message == "task.step 1 (approach): speed_mm_s of 12 is above limits.correction_mm_s"


# --- settings of single steps


@pytest.mark.parametrize(
    ("step", "settings", "message"),
    [
        (Approach, {"speed_mm_s": 0.0}, "speed_mm_s"),
        (Approach, {"contact_n": -1.0}, "contact_n"),
        (Approach, {"at_most_mm": math.nan}, "at_most_mm"),
        (Track, {"path": LINE, "speed_mm_s": 0.0}, "speed_mm_s"),
        (Track, {"path": LINE, "for_s": 0.0}, "for_s"),
        (Track, {"path": LINE, "lateral_limit_n": 0.0}, "lateral_limit_n"),
        (Track, {"path": LINE, "feed_error_n": -2.0}, "feed_error_n"),
        (Track, {"path": LINE, "across_mm": 0.0}, "across_mm"),
        (Track, {"path": LINE, "across": "force"}, "across_n must be a force that is not 0"),
        (Hold, {"for_s": 0.0}, "for_s"),
        (Hold, {"for_s": 1.0, "force_n": -1.0}, "force_n"),
        (Seek, {"direction_deg": math.nan}, "direction_deg must be a number"),
        (Seek, {"direction_deg": 0.0, "at_most_mm": 0.0}, "at_most_mm"),
        (Seek, {"direction_deg": 0.0, "back_off_mm": -1.0}, "back_off_mm"),
        (Retract, {"back_mm": -1.0}, "back_mm"),
        (Retract, {"speed_mm_s": 0.0}, "speed_mm_s"),
        (Move, {"to_mm": (0.0, 0.0), "speed_mm_s": 0.0}, "speed_mm_s"),
        (Move, {"to_mm": (math.nan, 0.0)}, "to_mm must be finite points in mm"),
        (Zero, {"for_ms": 0.0}, "for_ms"),
        (Zero, {"settle_ms": -1.0}, "settle_ms"),
        (Zero, {"at_most_n": 0.0}, "at_most_n"),
        (Criterion, {"within_n": 0.0}, "within_n"),
        (Criterion, {"within_n": 1.0, "for_percent": 100.5}, "for_percent must be at most 100"),
        (Repeat, {"times": 0, "step": (Zero(),)}, "times must be 1 … 1000, got 0"),
        (Repeat, {"times": 1001, "step": (Zero(),)}, "times must be 1 … 1000, got 1001"),
        (Repeat, {"times": 2, "step": ()}, "step must hold at least one step"),
        (Repeat, {"times": 2, "step": (Zero(),), "until_removed_mm": 1.0}, "needs a track among the steps"),
        (Repeat, {"times": 2, "step": (Track(path=LINE),), "until_removed_mm": 0.0}, "until_removed_mm"),
    ],
)
def test_invalid_step_settings_are_refused(step, settings, message):
    with pytest.raises(ValueError, match=message):
        step(**settings)


# --- how long it takes


def test_leg_duration_is_estimated():
    row = row_of(
        Move(to_mm=(3.0, 4.0), speed_mm_s=5.0),
        Zero(settle_ms=1000.0, for_ms=500.0),
        Approach(speed_mm_s=2.0, at_most_mm=16.0),
        Track(path=LINE, speed_mm_s=4.0),
        Track(path=LINE, speed_mm_s=4.0, for_s=1.0),
        Hold(for_s=3.0),
        Retract(back_mm=10.0, speed_mm_s=5.0),
    )
    assert seconds(row) == pytest.approx([1.0, 1.5, 2.0, 2.5, 1.0, 3.0, 2.0])


def test_endless_track_is_refused():
    row = row_of(Approach(), Track(path=LINE), Retract(), speed_mm_s=0.0)
    with pytest.raises(
        ConfigError, match=re.escape("task.step 2 (track): it never ends; give speed_mm_s above 0")
    ):
        seconds(row)
    assert seconds(row_of(Approach(), Track(path=LINE, for_s=2.0), Retract(), speed_mm_s=0.0))[1] == 2.0
