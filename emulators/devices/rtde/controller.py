"""Emulated controller: its cycle, and the interaction of its parts. An `EmulatedRobot`.

Its parts are power and safety (`safety`), the program (`player`), registers (`io`), the arm (`manipulator`) and the
force of the arm (`force_reading`). Three servers, RTDE, dashboard and script port, read and change its state; see
`connection`, `dashboard` and `script`. `profile` marks what is assumed.
"""

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping

from emulators.arm.cycled import ROUNDING_S, CycledPath
from emulators.devices.rtde.arm import Brake, Hold, Order, Paces
from emulators.devices.rtde.compliance import Compliance, ToolState
from emulators.devices.rtde.force_reading import ForceReading
from emulators.devices.rtde.io import EXTERNAL_FORCE, RegisterBank
from emulators.devices.rtde.manipulator import Manipulator
from emulators.devices.rtde.motions import Motions
from emulators.devices.rtde.player import Player
from emulators.devices.rtde.profile import RtdeProfile
from emulators.devices.rtde.running import Console, Program
from emulators.devices.rtde.safety import RobotState, Stimulus
from emulators.devices.rtde.state import Snapshot
from emulators.devices.rtde.timers import Timers
from emulators.orders import Act, Orders, ReceivedOrder
from emulators.seams import StartPose
from emulators.unmodelled import Unmodelled
from protocol.devices.rtde.fields import Value
from protocol.devices.rtde.packets import Version
from protocol.devices.rtde.states import Runtime, SafetyMode
from protocol.geometry import Pose, Wrench

_NO_FORCE: Wrench = (0.0,) * 6


class Controller:
    """Controller with its arm, powered up and ready to move."""

    def __init__(self, profile: RtdeProfile, start: StartPose, now: float, seed: int) -> None:
        """Power up. Raises ValueError for a start that the arm cannot hold."""
        self.profile = profile
        a, b, c, d = map(int, profile.version.split("."))
        self.version = Version(a, b, c, d)
        self.manipulator = Manipulator(profile, start, seed)
        self.arm, self.period = self.manipulator.arm, self.manipulator.period
        self.path = CycledPath(self.manipulator.tool_pose, now, self.period, self._cycle)
        self.force = ForceReading(profile, seed, now)
        self.compliance = Compliance(profile, self.period, self.manipulator.lengths)
        self.io, self.timers, self.console = RegisterBank(), Timers(), Console()
        self.state = RobotState(profile, self.timers)
        self.counts: Counter[str] = Counter()
        """Numbers of refusals and stops by name, for tests and operators."""
        start_delay = profile.start_delay_ms / 1000.0
        self.player = Player(start_delay, self.console, self.compliance, self.counts)
        self.orders, self.unmodelled = Orders(), Unmodelled("rtde")
        """Orders of clients, for a judge, and uses of parts that are not modelled."""
        self.motions = Motions(self)
        self.now = now
        first = self._snapshot(now)
        self.snapshots: deque[Snapshot] = deque([first], profile.output_delay_cycles + 1)
        """Recent states; the outputs report the oldest one."""

    # --- time

    def advance(self, now: float) -> None:
        """Run all cycles up to `now`. A process that is late has not read its clients in the missed cycles."""
        if (late := now - self.now - self.period) > ROUNDING_S:
            self.force.watchdog.last += late
            self.player.delay_watchdogs(late)
        self.path.advance(now)

    def _cycle(self, now: float) -> Pose:
        self.now = now
        manipulator, player, io = self.manipulator, self.player, self.io
        manipulator.begin_cycle(self.path.cycle)
        self.timers.run(now)
        if player.begin_due(now) and self.profile.zero_at_start:
            self.zero_force()
        self._watch(now)
        player.cycle(now)
        if self.orders.listener is not None:
            player.uploads.rehearse()
        self._guard()
        self.console.report_safety(self.state.safety)
        paces = Paces(io.slider if self.profile.slider_slows_servo else 1.0, io.slider)
        tool = ToolState(manipulator.tcp, self.force.tool_force)
        if problem := self.compliance.step(self.arm, paces, self.plays, tool):
            self.protective_stop(problem)
        self.snapshots.append(self._snapshot(now))
        self.compliance.history.note(manipulator.joints, self.snapshots[-1].force)
        return manipulator.end_cycle()

    def _watch(self, now: float) -> None:
        if self.player.runtime != Runtime.PLAYING:
            return
        if self.force.is_overdue(now):
            self.counts["external force missing"] += 1
            self.player.pause()
        else:
            self.player.check_watchdogs(now)

    def _guard(self) -> None:
        """Trigger a stop for motion beyond the limits. Hold the arm while it is not allowed to move."""
        manipulator = self.manipulator
        if self.state.may_move and (
            problem := manipulator.problem_of_speed()
            or self.force.problem()
            or manipulator.problem_of_range()
        ):
            self.protective_stop(problem)
        if not self.state.may_move:
            self.arm.take(Hold())
        elif self.player.runtime != Runtime.PLAYING:
            self.arm.take(Brake(self.profile.stop_deceleration_rad_s2))

    def _snapshot(self, now: float) -> Snapshot:
        manipulator, state, io = self.manipulator, self.state, self.io
        force = self.force.read(self.now, io.inputs, manipulator)
        raw = io.inputs.get(EXTERNAL_FORCE, _NO_FORCE) if self.force.external else _NO_FORCE
        assert isinstance(raw, tuple), "a vector"
        r, s, t, u, v, w = raw
        return Snapshot(
            self.path.cycle,
            self.profile.uptime_s + now - self.path.cycle_at(0),
            self.period,
            manipulator.lengths,
            manipulator.sensors,
            manipulator.joints,
            manipulator.speeds,
            self.arm.joints,
            self.arm.motion,
            manipulator.speeds_before,
            manipulator.forward(manipulator.joints),
            manipulator.tcp_pose,
            manipulator.tcp,
            force,
            (r, s, t, u, v, w),
            state.mode,
            state.safety,
            self.player.runtime,
            io.slider,
            self.force.payload,
            io.inputs,
            io.outputs,
        )

    def zero_force(self) -> None:
        """Zero the arm's force sensor at the current force."""
        self.force.zero()
        self.compliance.history.forget()

    def write_inputs(self, names: tuple[str, ...], values: Mapping[str, Value]) -> None:
        """Write a package of inputs. This feeds the watchdogs of these inputs."""
        force = values.get(EXTERNAL_FORCE, _NO_FORCE)
        if isinstance(force, tuple) and not all(map(math.isfinite, force)):
            self.protective_stop("an external force that is not a number")
            return
        self.io.write_inputs(values)
        self.motions.news += 1
        self.motions.accept_package(names)
        self.player.feed_watchdogs(names, self.now)
        if EXTERNAL_FORCE in names:
            self.force.watchdog.last = self.now

    # --- for a judge of a client

    @property
    def plays(self) -> bool:
        """Whether a program is running and the arm may move."""
        return self.player.runtime == Runtime.PLAYING and self.state.may_move

    @property
    def reported_pose_now(self) -> Pose:
        """Return the reported pose of the controller's tool, without noise."""
        return self.snapshots[-1].now

    def report_order(self, act: Act, text: str, accepted: bool, moves: bool = True) -> None:
        """Report an order without a position."""
        self.orders.tell(ReceivedOrder(self.now, act, text, accepted, moves=moves))

    # --- orders to programs and to the arm

    def start_program(self, make: Callable[[], Program], in_time: bool = True) -> bool:
        """Start a complete program. A running program is stopped first.

        Return False, without effect, if the controller accepts no programs.
        """
        if not (in_time and self.state.takes_programs):
            self.counts["programs refused"] += 1
            return False
        self.player.start(make, self.now)
        return True

    def play(self) -> bool:
        """Resume a paused program. Return False if no program is paused, or if the robot may not move."""
        return self.state.may_move and self.player.resume(self.now)

    def order(self, order: Order) -> None:
        """Pass a program's order for this cycle to the arm."""
        if problem := self.manipulator.take(order):
            self.protective_stop(problem)

    def target_changed(self) -> None:
        """Record that a program has a new target from this cycle on."""
        self.path.targets.accept(self.now - self.period)
        self.path.targets.begin_newest(self.now)

    # --- stops

    def protective_stop(self, why: str) -> None:
        """Stop the arm at once, and pause or stop the program. No effect during a more severe stop."""
        if not self.state.begin_protective_stop(why, self.now):
            return
        self.counts[f"protective stop: {why}"] += 1
        if self.profile.on_protective_stop == "stopped" or not self.player.pause():
            self.player.stop(self.now)
        self.arm.take(Hold())

    def emergency_stop(self, mode: SafetyMode = SafetyMode.ROBOT_EMERGENCY_STOP, by: str = "a fault") -> None:
        """Remove power and stop the program. The stop lasts until everyone who pressed the emergency stop has
        released it.
        """
        self.counts["emergency stop"] += 1
        self.state.press_emergency_stop(mode, by)
        self.power_off()

    def open_safeguard(self) -> None:
        """Open a safeguard, which stops the arm and pauses the program. No effect during any other stop."""
        if self.state.apply(Stimulus.SAFEGUARD_OPEN):
            self.player.pause()

    def power_off(self) -> None:
        """Switch the power off. The brakes hold the arm."""
        self.player.stop(self.now)
        self.state.power_off()
        self.arm.take(Hold())
