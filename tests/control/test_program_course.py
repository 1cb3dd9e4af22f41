"""Course of a program, sample by sample, on a synthetic surface, with a tool that follows at once."""

import itertools
import math

import pytest
from msgspec.structs import replace

from hil_bridge.control import Command, Measurement, Phase, Sample, Stroke, StrokeState, TaskParameters
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.facing import FacingState, inward
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.state import Course, StepState, Tally
from hil_bridge.control.course.stroke import Order
from hil_bridge.control.geometry.work_frame import WorkFrame
from hil_bridge.control.program.legs import Ground, legs_of
from hil_bridge.control.program.orienting import turn_tool
from hil_bridge.control.program.program import Program
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.hold import Hold
from hil_bridge.control.steps.move import Move
from hil_bridge.control.steps.paths import Line, Polyline
from hil_bridge.control.steps.repeat import Repeat
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import Criterion, StepContext, StepResult
from hil_bridge.control.steps.seek import Seek
from hil_bridge.control.steps.track import Track
from hil_bridge.control.steps.zero import Zero
from hil_bridge.errors import Cause, Reason
from protocol.geometry import angle_between, rotate
from tests.control.plain import sense

DT = 0.1
DOWN = 0.0, 1.0, 0.0, 0.0
FRAME = WorkFrame(approach=(0.0, 0.0, -1.0), x=(1.0, 0.0, 0.0), y=(0.0, 1.0, 0.0))
LINE = Line(length_mm=20.0)
STIFFNESS = 5000.0


class Presses:
    """Controller that corrects nearly the entire error at once, because the stiffness is known."""

    name = "presses"

    def initial(self):
        return 0

    def step(self, state, measurement, reference):
        correction = 0.9 * (reference - measurement.force) / STIFFNESS
        return state, Command(measurement.commanded + correction, correction, stiffness=STIFFNESS)


def program_of(*steps, safe_height=0.0):
    # a retract goes back by more than an approach goes by default
    stroke = Stroke(TaskParameters(approach_depth_limit_mm=30.0), Presses(), 50.0, 1e-6)
    row = legs_of(steps, Ground(stroke, Limits(), 50.0))
    return Program(row, stroke, FRAME, safe_height=safe_height)


def contact_at(at, position, depth, force, orientation=DOWN):
    """Sample of a stationary tool at its ordered position."""
    measurement = Measurement(at, force[0], depth, depth, dt=DT)
    sample = Sample(
        at,
        (*position, -depth),
        force[0],
        math.hypot(*force),
        at,
        round(at / DT),
        force_travel=force[1],
        wrench=(0.0,) * 6,
        quaternion=orientation,
        force_across=force[2],
    )
    return ContactSample(sample, measurement, position, force, (0.0,) * 6)


def flat(x, y):
    return 2e-3


def drive(program, surface=flat, push=lambda depth, x, y: (0.0, 0.0), reported_at=lambda x, y: (x, y)):
    """Return every sample's state and output until the end. `push` returns the forces along x and y, and
    `reported_at` the position that the robot reports.
    """
    state, depth, (x, y), orientation, reported = program.initial(), 0.0, (0.0, 0.0), DOWN, []
    for k in range(2000):
        force = STIFFNESS * max(depth - surface(x, y), 0.0)
        contact = contact_at(k * DT, reported_at(x, y), depth, (force, *push(depth, x, y)), orientation)
        state, output = program.step(*sense(program, state, contact))
        depth, x, y = output.target.depth, output.target.travel, output.target.across
        orientation = output.turned or orientation
        reported.append((state, output, force))
        if state.phase is Phase.END:
            return reported
    raise AssertionError("the program never ended")


def done(results):
    return results[-1][0].course.done


# --- the row of steps


def test_program_runs_and_reports_each_step():
    program = program_of(Approach(name="touch"), Track(path=LINE), Hold(for_s=2.0, name="place"), Retract())
    outputs = drive(program)
    approach, track, hold, retract = done(outputs)
    assert all(step.passed for step in (approach, track, hold, retract))
    assert [step.leg for step in done(outputs)] == [0, 1, 2, 3]
    assert approach.ended == track.began
    assert track.way == pytest.approx(20e-3, abs=0.6e-3)
    assert track.force_mean == pytest.approx(10.0, abs=0.5)
    assert hold.ended - hold.began == pytest.approx(2.0, abs=2 * DT)
    assert approach.found[2] == pytest.approx(-2e-3, abs=0.5e-3)
    assert hold.found == pytest.approx((20e-3, 0.0, -2e-3 - 10.0 / STIFFNESS), abs=0.6e-3)
    assert outputs[-1][1].target.depth <= 0.0
    assert {output.phase for _, output, _ in outputs} >= {Phase.APPROACH, Phase.TRACK, Phase.RETRACT}


def test_program_tool_follows_path_at_set_speed():
    corners = ((0.0, 0.0), (10.0, 0.0), (10.0, 5.0))
    program = program_of(Approach(), Track(path=Polyline(points_mm=corners), speed_mm_s=4.0), Retract())
    positions = [
        (output.target.travel, output.target.across)
        for _, output, _ in drive(program)
        if output.phase is Phase.TRACK
    ]
    assert max(math.dist(a, b) for a, b in itertools.pairwise(positions)) <= 4e-3 * DT + 1e-9
    for x, y in positions:  # on one of the two pieces
        assert (abs(y) < 1e-9 and x <= 10e-3 + 1e-9) or (abs(x - 10e-3) < 1e-9 and y < 5.5e-3)


def test_program_force_follows_profile():
    profile = ((0.0, 5.0), (10.0, 15.0), (20.0, 5.0))
    program = program_of(
        Approach(),
        Track(
            path=LINE, speed_mm_s=2.0, force_n=profile, criterion=Criterion(within_n=0.5, for_percent=80.0)
        ),
        Retract(),
    )
    outputs = drive(program)
    track = done(outputs)[1]
    assert track.passed
    assert track.within > 0.8
    assert track.force_mean == pytest.approx(10.0, abs=0.3)
    expected = [output.reference for state, output, _ in outputs if output.reference is not None]
    assert max(expected) == pytest.approx(15.0, abs=0.3)
    assert expected[-1] == pytest.approx(5.0, abs=0.3)


def test_missed_criterion_fails_step_but_not_run():
    program = program_of(
        Approach(), Track(path=LINE, criterion=Criterion(within_n=1e-3, for_percent=100.0)), Retract()
    )
    outputs = drive(program)
    state = outputs[-1][0]
    assert (state.course.reason, state.course.failed) == (None, False)
    assert not done(outputs)[1].passed
    assert "required 100 %" in done(outputs)[1].text
    assert len(done(outputs)) == 3


def test_repeat_ends_when_depth_is_removed():
    passes = []

    def worn(x, y):
        return 2e-3 + 0.1e-3 * len(passes)

    program = program_of(
        Repeat(
            times=10,
            until_removed_mm=0.25,
            step=(Approach(), Track(path=LINE), Retract(), Move(to_mm=(0.0, 0.0))),
        ),
        Retract(),
    )
    state, depth, position = program.initial(), 0.0, (0.0, 0.0)
    for k in range(5000):
        passes[:] = [step for step in state.course.done if step.leg % 4 == 1]
        force = STIFFNESS * max(depth - worn(*position), 0.0)
        contact = contact_at(k * DT, position, depth, (force, 0.0, 0.0))
        state, output = program.step(*sense(program, state, contact))
        depth, position = output.target.depth, (output.target.travel, output.target.across)
        if state.phase is Phase.END:
            break
    assert state.phase is Phase.END
    assert len(passes) == 4, "0.1 mm a pass: the fourth lies 0.3 mm deeper than the first"
    message = state.course.done[-2].text
    assert float(message.removesuffix(" mm removed")) == pytest.approx(0.3, abs=0.01)


def test_repeat_depth_is_mean_over_all_paths():
    """20 mm on a surface 2 mm deep and 40 mm on one 3 mm deep; a hold adds no distance."""
    long, back = Line(length_mm=30.0), Line(length_mm=10.0, direction_deg=180.0)
    strokes = (
        (Approach(), Track(path=LINE), Retract()),
        (Move(to_mm=(0.0, 50.0)), Approach(), Track(path=long), Track(path=back), Hold(for_s=3.0), Retract()),
    )
    program = program_of(Repeat(times=1, step=(*strokes[0], *strokes[1])), Retract())
    outputs = drive(program, surface=lambda x, y: 2e-3 if y < 25e-3 else 3e-3)
    pressed = 10.0 / STIFFNESS
    mean = (20.0 * 2e-3 + (30.0 + 10.0) * 3e-3) / 60.0 + pressed
    assert outputs[-1][0].course.first_pass == pytest.approx(mean, abs=0.05e-3)
    sums = [step.force_mean for step in done(outputs) if step.force_mean is not None]
    assert sums == pytest.approx([10.0] * len(sums), abs=0.5)


def test_reverse_travel_and_bad_force_do_not_count():
    program = program_of(Approach(), Track(path=LINE), Retract())
    leg, tracking = program.row.legs[1], StrokeState(Phase.TRACK, travel=5e-3, in_contact=True)
    course = Course(leg=1, base=1e-3)
    start = StepState(tracking)

    def count(travel, force, before=start, depth=2e-3, in_contact=True):
        after = replace(tracking, travel=travel, in_contact=in_contact)
        context = StepContext(leg, course, contact_at(0.0, (0.0, 0.0), depth, (force, 0.0, 0.0)))
        return leg.step.count_sample(context, before, after, 10.0)

    good = count(6e-3, 10.5)
    assert good == Tally(1e-3, 1e-3, pytest.approx(10.5e-3), pytest.approx(2e-6), pytest.approx(5e-3))
    assert count(4e-3, 10.5).total == 0.0
    off = count(7e-3, 12.0, replace(start, tally=good))
    assert (off.total, off.within, off.good) == pytest.approx((3e-3, 1e-3, 5e-3))
    lost = count(5e-3, 0.0, depth=0.0, in_contact=False)
    assert lost == Tally()


def test_compliant_tool_yields_sideways_on_any_axis():
    """A force of 4 N against +x moves the tool towards −x while its path runs along y."""
    line = Line(length_mm=10.0, direction_deg=90.0)
    track = Track(path=line, across="compliant", across_n_mm=2.0, speed_mm_s=2.0)
    outputs = drive(program_of(Approach(), track, Retract()), push=lambda depth, x, y: (4.0, 0.0))
    positions = [intent.target for _, intent, _ in outputs if intent.phase is Phase.TRACK]
    assert positions[-1].travel == pytest.approx(-2e-3, abs=0.1e-3), "4 N at 2 N/mm, away from the force"
    assert positions[-1].across == pytest.approx(10e-3, abs=0.3e-3)


# --- end of a program


def test_touch_in_free_space_ends_run():
    program = program_of(Move(to_mm=(20.0, 0.0)), Retract(), safe_height=1e-3)
    outputs = drive(program, push=lambda depth, x, y: (5.0 if x > 10e-3 else 0.0, 0.0))
    state, output, _ = outputs[-1]
    assert (
        str(state.course.reason) == "the tool touches something in free space, with 5.0 N, in step 1 (move)"
    )
    assert state.course.reason.cause is Cause.TOUCH
    assert not done(outputs)[0].passed
    assert done(outputs)[0].text == str(state.course.reason)
    assert output.target.travel <= 12e-3 + 1e-9, "20 mm/s, and so 2 mm a sample"


def test_wall_ends_step_without_further_press():
    program = program_of(Approach(), Track(path=LINE, lateral_limit_n=8.0), Retract())
    outputs = drive(program, push=lambda depth, x, y: (max(x - 10e-3, 0.0) * 20e3, 0.0))
    state = outputs[-1][0]
    assert state.course.failed
    assert str(state.course.reason).endswith("there is an obstacle, in step 2 (track)")
    assert state.course.reason.cause in (Cause.NO_PROGRESS, Cause.STEP_WALL)
    assert max(output.target.travel for _, output, _ in outputs) <= 10e-3 + 8.0 / 20e3 + 5.5e-3 * DT


def test_seek_finds_edge_at_surface_end():
    program = program_of(
        Approach(), Seek(direction_deg=0.0, until="edge", name="edge", speed_mm_s=2.0), Retract()
    )
    outputs = drive(program, surface=lambda x, y: 2e-3 if x < 12e-3 else 1.0)
    assert not outputs[-1][0].course.failed
    assert done(outputs)[1].found[0] == pytest.approx(12e-3, abs=0.5e-3)


@pytest.mark.parametrize("aside_mm", [1.0, 4.0])
def test_across_force_works_from_any_position(aside_mm):
    """The path begins there, and a wall is 1 mm to the left of it."""
    to = Track(path=Polyline(points_mm=((0.0, 0.0), (0.0, aside_mm))), speed_mm_s=4.0)
    along = Track(path=LINE, across="force", across_n=5.0, speed_mm_s=2.0)
    wall = aside_mm * 1e-3 + 1e-3
    program = program_of(Approach(), to, along, Retract())
    outputs = drive(program, push=lambda depth, x, y: (0.0, STIFFNESS * max(y - wall, 0.0)))
    positions = [
        output.target.across
        for state, output, _ in outputs
        if state.course.leg == 2 and not state.course.failed
    ]
    pressed = wall + 5.0 / STIFFNESS
    assert positions[-1] == pytest.approx(pressed, abs=0.1e-3)
    assert max(positions) <= pressed + 0.1e-3


@pytest.mark.parametrize("direction_deg", [0.0, 90.0, 30.0])
@pytest.mark.parametrize("aside_mm", [1.0, 4.0])
def test_blocked_sideways_tool_is_not_ordered_farther(aside_mm, direction_deg):
    """The robot is blocked without a lateral force; the order leads by at most what the allowed force permits."""
    limit, angle = aside_mm * 1e-3 + 0.5e-3, math.radians(direction_deg)
    u, v = -math.sin(angle), math.cos(angle)  # to the left of the path
    start = aside_mm * u, aside_mm * v

    def reported_at(x, y):
        beyond = max(x * u + y * v - limit, 0.0)
        return x - beyond * u, y - beyond * v

    to = Track(path=Polyline(points_mm=((0.0, 0.0), start)), speed_mm_s=4.0)
    path = Line(length_mm=20.0, direction_deg=direction_deg)
    along = Track(path=path, across="force", across_n=5.0, speed_mm_s=2.0)
    outputs = drive(program_of(Approach(), to, along, Retract()), reported_at=reported_at)
    targets = [
        output.target for state, output, _ in outputs if state.course.leg == 2 and not state.course.failed
    ]
    ahead = [target.travel * u + target.across * v - limit for target in targets]
    allowed, slowly = 10.0 / STIFFNESS, 0.2e-3 * DT  # an approach never stops completely
    assert allowed - slowly <= ahead[12] <= allowed + 6 * slowly
    assert max(ahead) <= allowed + slowly * len(ahead)


def test_seek_edge_starts_at_tool_position():
    """After a track of 4 mm along y, the tool continues along x from there without a jump."""
    aside = Track(path=Polyline(points_mm=((0.0, 0.0), (0.0, 4.0))), speed_mm_s=4.0)
    program = program_of(
        Approach(), aside, Seek(direction_deg=0.0, until="edge", at_most_mm=9.0, speed_mm_s=2.0), Retract()
    )
    sought = [
        output.target
        for state, output, _ in drive(program)
        if state.course.leg == 2 and not state.course.failed
    ]
    assert all(target.across == pytest.approx(4e-3, abs=0.5e-3) for target in sought)
    assert max(
        math.dist((a.travel, a.across), (b.travel, b.across)) for a, b in itertools.pairwise(sought)
    ) <= (4e-3 * DT + 1e-9)
    assert sought[-1].travel == pytest.approx(9e-3, abs=0.5e-3)


def test_seek_missing_edge_is_reported_with_step():
    program = program_of(
        Approach(), Seek(direction_deg=0.0, until="edge", at_most_mm=10.0, speed_mm_s=2.0), Retract()
    )
    assert str(drive(program)[-1][0].course.reason) == "no edge within 10 mm, in step 2 (seek)"
    assert drive(program)[-1][0].course.reason.cause is Cause.NO_EDGE


def test_seek_finds_obstacle_in_free_space():
    program = program_of(Seek(direction_deg=90.0, name="fence", speed_mm_s=2.0, back_off_mm=2.0), Retract())
    outputs = drive(program, push=lambda depth, x, y: (0.0, max(y - 5e-3, 0.0) * 5e3))
    assert done(outputs)[0].found[1] == pytest.approx(5.2e-3, abs=0.3e-3)
    assert outputs[-1][1].target.across == pytest.approx(3.2e-3, abs=0.3e-3)


# --- the normal


def normal_program(**track):
    return program_of(Approach(), Track(path=LINE, orientation="normal", speed_mm_s=5.0, **track), Retract())


def sloped(slope, friction=0.0):
    """Return a surface that falls along x, and its force along x."""

    def push(depth, x, y):
        force = STIFFNESS * max(depth - 2e-3 - slope * x, 0.0)
        return force * (friction - slope) / (1.0 + friction * slope), 0.0

    return (lambda x, y: 2e-3 + slope * x), push


@pytest.mark.parametrize("slope", [0.0, 0.1, -0.15])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_tool_turns_perpendicular_to_slope(slope, friction):
    surface, push = sloped(slope, friction)
    outputs = drive(normal_program(), surface, push=push)
    turned = [output.turned for _, output, _ in outputs if output.phase is Phase.TRACK][-1] or DOWN
    x, _, z = rotate(turned, (0.0, 0.0, 1.0))
    assert math.degrees(math.atan2(-x, -z)) == pytest.approx(math.degrees(math.atan(slope)), abs=1.0)


def test_tool_turn_rate_is_limited():
    surface, push = sloped(0.2)
    outputs = drive(normal_program(), surface, push=push)
    ordered = [output.turned or DOWN for _, output, _ in outputs]
    most = max(angle_between(a, b) for a, b in itertools.pairwise(ordered))
    assert 0.0 < most <= math.radians(10.0) * DT


def test_growing_force_on_flat_surface_is_not_a_slope():
    program = normal_program(force_n=((0.0, 5.0), (20.0, 25.0)))
    outputs = drive(program)
    state = outputs[-1][0]
    assert math.degrees(math.atan(state.course.facing.fall[0])) == pytest.approx(0.0, abs=0.5)


@pytest.mark.parametrize(("sigma_deg", "turns"), [(1.0, True), (3.0, False), (math.inf, False)])
def test_uncertain_normal_does_not_turn_tool(sigma_deg, turns):
    program = program_of(Approach(), Hold(for_s=3.0, orientation="normal"), Retract())
    outputs = drive(program)
    state = next(state for state, output, _ in outputs if output.phase is Phase.TRACK)
    facing = FacingState(fall=(0.2, 0.0), sigma=math.radians(sigma_deg))
    state = replace(state, course=replace(state.course, facing=facing, turned=None))
    leg = program.row.legs[state.course.leg]
    assert leg.step.do == "hold"
    turned = turn_tool(state, leg, program.frame, program.facing, DT)
    assert (turned is not None) == turns
    if turns:
        result = rotate(turned, (0.0, 0.0, 1.0))
        expected = inward((0.2, 0.0))
        assert result[0] < 0.0
        assert abs(result[0]) < abs(expected[1])


def test_move_without_arrival_ends_run():
    leg = program_of(Move(to_mm=(3.0, 0.0)), Retract()).row.legs[0]
    course, state = Course(start=(0.0, 0.0), home=DOWN, began=0.0), StepState(StrokeState(Phase.MOVE))
    result, at = StepResult(state, Order(Phase.MOVE, 0.0)), 0.0
    while result.trouble is None and at < 60.0:
        at += DT
        contact = contact_at(at, (0.0, 0.0), 0.0, (0.0, 0.0, 0.0))
        result = leg.step.take(StepContext(leg, course, contact), result.state)
        assert not result.done
    assert "does not reach its target" in result.trouble.text
    assert result.trouble.cause is Cause.NOT_THERE
    assert 5.0 < at < 6.0


def test_end_during_retraction_does_not_order_deeper():
    program = program_of(Approach(), Retract(back_mm=40.0), Approach(), Retract())
    state, depth = program.initial(), 0.0
    while depth > -35e-3:  # farther back than task.retract_mm
        state, intent = program.step(
            *sense(
                program,
                state,
                contact_at(0.1, (0.0, 0.0), depth, (max(depth - 2e-3, 0.0) * STIFFNESS, 0.0, 0.0)),
            )
        )
        depth = intent.target.depth
    state = program.finish(state, Reason(Cause.SIGNAL, "enough"))
    state, intent = program.step(*sense(program, state, contact_at(0.2, (0.0, 0.0), depth, (0.0, 0.0, 0.0))))
    assert intent.phase is Phase.RETRACT
    assert intent.target.depth <= depth


def test_zero_step_applies_from_next_step():
    wrench = (0.5, 0.0, -1.0, 0.0, 0.01, 0.0)
    program = program_of(Zero(settle_ms=100.0, for_ms=200.0), Approach(), Retract())
    state = program.initial()
    for k in range(20):
        at = k * DT
        sample = replace(contact_at(at, (0.0, 0.0), 0.0, (1.0, 0.0, 0.0)).sample, wrench=wrench)
        state, contact = program.sense(state, sample, (0.0, 0.0, 0.0), 0.0, DT)
        if state.course.leg == 1:
            break
        state, _ = program.step(state, contact)
    assert state.course.zero == pytest.approx(wrench)
    assert contact.wrench == pytest.approx((0.0,) * 6)
    assert contact.force[0] == pytest.approx(0.0), (
        "DOWN turns -1 N of the tool frame into 1 N along the approach"
    )
