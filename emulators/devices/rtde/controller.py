"""The emulated controller: modes, safety, programs and the arm, cycle by cycle. An `EmulatedRobot`.

Its three servers, RTDE, dashboard and script port, each look at it and act on it; see `connection`, `dashboard` and
`script`. Marks of what is assumed stand in `profile`.
"""

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping

from emulators.arm.cycled import ROUNDING_S, CycledPath
from emulators.devices.rtde.arm import ZERO, Brake, Hold, JointArm, Order, Paces, Place, Servo
from emulators.devices.rtde.compliance import TOO_FAST, Compliance, Felt
from emulators.devices.rtde.drives import ArmSensors, Drives
from emulators.devices.rtde.force_reading import ForceReading, Load, Tool
from emulators.devices.rtde.io import MASKS, read_slider, switch_outputs
from emulators.devices.rtde.kinematics import (
    ARMS,
    RANGE,
    USUAL,
    Joints,
    ToolPoses,
    compose,
    flange,
    invert,
    nearest,
)
from emulators.devices.rtde.motions import Motions
from emulators.devices.rtde.profile import RtdeProfile
from emulators.devices.rtde.running import Console, Program, Saying, Watchdog
from emulators.devices.rtde.state import Registers, Snapshot, number_in
from emulators.devices.rtde.targets import problem_of_start, problem_of_target
from emulators.devices.rtde.uploads import Uploads
from emulators.devices.rtde.urscript import Message
from emulators.orders import Act, HeardOrder, Hindrance, Orders
from emulators.seams import StartPose
from emulators.unmodelled import Unmodelled
from protocol.devices.rtde.fields import Value
from protocol.devices.rtde.packets import Version
from protocol.devices.rtde.states import STOPPED_MODES, RobotMode, Runtime, SafetyMode
from protocol.geometry import Pose, Vector, Wrench, normalise

_LEVEL: Pose = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
_NO_FORCE: Wrench = (0.0,) * 6
BY_FAULT = "as a fault"
"""Reason of a protective stop that no client has caused."""


class Controller:
    """A controller with its arm, powered up and ready."""

    def __init__(self, profile: RtdeProfile, start: StartPose, now: float, seed: int) -> None:
        """Raises ValueError for a start that its arm cannot hold."""
        self.profile = profile
        self.period = profile.cycle_ms / 1000.0
        a, b, c, d = map(int, profile.version.split("."))
        self.version = Version(a, b, c, d)
        self.lengths = ARMS[profile.model]
        self.tool = Pose((0.0, 0.0, start.tool_length), _LEVEL.quaternion)
        """The tool as it is, in the flange."""
        self.tcp = self.tool
        """The tool as the controller takes it to be."""
        self.payload: tuple[float, ...] = (0.0,) * 4
        pose = Pose(start.position, normalise(start.quaternion))
        joints = nearest(self.lengths, compose(pose, invert(self.tool)), USUAL)
        if joints is None:
            raise ValueError(problem_of_start(profile.model, pose, self.tool))
        self.arm = JointArm(joints, self.period, profile.servo_gain_scale, profile.stop_deceleration_rad_s2)
        self.compliance = Compliance(profile, self.period, self.lengths)
        self._flange = self._old_flange = self._next_flange = flange(self.lengths, joints)
        self._at = ToolPoses().at
        self._drives, self._sensors = Drives(profile, joints, seed), ArmSensors(profile, seed)
        self.joints, self.speeds = self._sensors.read(joints, 0), ZERO
        """As measured at the begin of this cycle, rad and rad/s."""
        self._target_speeds = ZERO
        """Of the cycle before, rad/s."""
        self.path = CycledPath(self._at(self._flange, self.tool), now, self.period, self._cycle)
        self._powered_at = now
        self.mode = RobotMode.RUNNING
        self.safety = self._told_safety = SafetyMode.NORMAL
        self.runtime = Runtime.STOPPED
        self.remote = profile.remote_control
        self.slider = 1.0
        """Share of its speed that a motion has from the next cycle on, 0 … 1 (assumed: without a ramp)."""
        self.programs: Mapping[str, bytes] = {}
        """Stored programs by name: text in URScript."""
        self.uploads = Uploads()
        self.loaded = ""
        """Name of the stored program that is loaded; empty for none."""
        self._emergency_stops: set[str] = set()
        """All that have pressed the emergency stop."""
        self.stopped_at = -math.inf
        """When the last protective stop came, s."""
        self.inputs: Registers = {}
        self.outputs: Registers = {}
        self.flags: set[int] = set()
        """Flags of programs that are set. Assumed: they outlive the program that has set them."""
        self.claims: dict[str, object] = {}
        """Inputs that a connection holds, by name."""
        self.external_force = False
        """Whether `external_force_torque` is its force sensor."""
        self._force_at = now
        """When the last external force came, s."""
        self.force = ForceReading(profile, seed)
        self.program: Program | None = None
        self.console = Console()
        """The messages of programs."""
        self.watchdogs: list[Watchdog] = []
        self._starting: tuple[float, Callable[[], Program]] | None = None
        self._pending: list[tuple[float, Callable[[], object]]] = []
        """Changes that come at a time."""
        self._powered = 0
        """How often the power has gone."""
        self._wanted = joints
        self.orders, self.unmodelled = Orders(), Unmodelled("rtde")
        """Orders of its clients, for a judge of them."""
        self.motions = Motions(self)
        self.stop_reason = ""
        """Words of the last protective stop."""
        self.counts: Counter[str] = Counter()
        """Refusals and stops, by name, for tests and people."""
        self.now = now
        first = self._snapshot(now)
        self.snapshots: deque[Snapshot] = deque([first], profile.output_delay_cycles + 1)
        """The oldest is what the outputs tell."""

    # --- as an emulated robot

    @property
    def accepted(self) -> int:
        return self.path.accepted

    def begun_at(self, target: int) -> float | None:
        return self.path.begun_at(target)

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        return nearest(self.lengths, compose(pose, invert(self.tool)), self.arm.joints)

    # --- time

    def advance(self, now: float) -> None:
        """Let all cycles up to `now` happen. A process that was late has not heard its clients meanwhile."""
        if (late := now - self.now - self.period) > ROUNDING_S:
            self._force_at += late
            for watchdog in self.watchdogs:
                watchdog.last += late
        self.path.advance(now)

    def _cycle(self, now: float) -> Pose:
        self.now = now
        self._old_flange = self._flange
        self._flange = self._next_flange
        self.joints = self._sensors.read(self._drives.joints, self.path.cycle)
        self.speeds = self._sensors.read_speeds(self._drives.speeds, self.path.cycle)
        while self._pending and self._pending[0][0] <= now:
            self._pending.pop(0)[1]()
        if self._starting is not None and self._starting[0] <= now:
            _, make = self._starting
            self._starting = None
            self.program, self.runtime = make(), Runtime.PLAYING
            if self.profile.zero_at_start:
                self.zero_force()
            self.console.tell(Saying(self.now, Message.STARTED, self.program.name))
        self._watch(now)
        if self.runtime == Runtime.PLAYING and self.program is not None and not self.program.cycle():
            self._end_program()
        if self.orders.listener is not None:
            self.uploads.rehearse()
        self._guard()
        if self.safety != self._told_safety:
            self._told_safety = self.safety
            self.console.tell_safety(self.safety)
        paces = Paces(self.slider if self.profile.slider_slows_servo else 1.0, self.slider)
        felt = Felt(self.tcp, self.force.felt)
        if problem := self.compliance.step(self.arm, paces, self.plays, felt):
            self.protective_stop(problem)
        self.snapshots.append(self._snapshot(now))
        self.compliance.history.note(self.joints, self.snapshots[-1].force)
        self._next_flange = flange(
            self.lengths, self._drives.step(self.arm.joints, isinstance(self.arm.order, Hold))
        )
        return self._at(self._next_flange, self.tool)

    def later(self, seconds: float, change: Callable[[], object]) -> None:
        """Do this after a time."""
        self._pending.append((self.now + seconds, change))
        self._pending.sort(key=lambda item: item[0])

    def _snapshot(self, now: float) -> Snapshot:
        exact = self._at(self._flange, self.tcp)
        told = self._feel()
        before, self._target_speeds = self._target_speeds, self.arm.motion
        raw = self.inputs.get("external_force_torque", _NO_FORCE) if self.external_force else _NO_FORCE
        assert isinstance(raw, tuple), "a vector"
        r, s, t, u, v, w = raw
        return Snapshot(
            self.path.cycle,
            self.profile.uptime_s + now - self._powered_at,
            self.period,
            self.lengths,
            self._sensors,
            self.joints,
            self.speeds,
            self.arm.joints,
            self._target_speeds,
            before,
            compose(flange(self.lengths, self.joints), self.tcp),
            exact,
            self.tcp,
            told,
            (r, s, t, u, v, w),
            self.mode,
            self.safety,
            self.runtime,
            self.slider,
            self.payload,
            self.inputs,
            self.outputs,
        )

    def _feel(self) -> Wrench:
        """actual_TCP_force: of a client's forces, or of those that the arm feels."""
        mass, *centre = self.payload
        x, y, z = centre
        tool = Tool(self._flange.quaternion, self.tcp, Load(mass, (x, y, z)))
        if self.external_force:
            return self.force.read_external(self.inputs.get("external_force_torque"), tool)
        return self.force.read_own(self.now, any(self.speeds), tool)

    def zero_force(self) -> None:
        """Take the force that the arm feels now for zero."""
        self.force.zero()
        self.compliance.history.forget()

    def carry(self, mass: float, centre: Vector) -> None:
        """The flange carries this, kg and m, and its operator has set that for the payload."""
        self.force.load, self.payload = Load(mass, centre), (mass, *centre)

    # --- inputs

    def write_inputs(self, names: tuple[str, ...], values: Mapping[str, Value]) -> None:
        """A package of inputs came; they hold for ever, and reset the watchdogs of their names."""
        force = values.get("external_force_torque", _NO_FORCE)
        if isinstance(force, tuple) and not all(map(math.isfinite, force)):
            self.protective_stop("an external force that is no number")
            return
        self.inputs = {**self.inputs, **values}
        self.motions.news += 1
        self.motions.hear_package(names)
        for watchdog in self.watchdogs:
            if watchdog.name in names:
                watchdog.last = self.now
        if "external_force_torque" in names:
            self._force_at = self.now
        if not MASKS.isdisjoint(names):
            self.outputs = switch_outputs(self.inputs, self.outputs)
        if "speed_slider_fraction" in names:
            self.slider = read_slider(self.inputs, self.slider)

    def number(self, name: str) -> float:
        """An input that is a number, 0 where nothing was written."""
        return number_in(self.inputs, name)

    def write_output(self, name: str, value: float) -> None:
        """A program writes a register."""
        if self.outputs.get(name, 0) != value:
            self.outputs = {**self.outputs, name: value}

    # --- for a judge of a client

    def hindrance(self, now: float) -> Hindrance | None:
        """Why the arm may not move."""
        if self.safety in STOPPED_MODES:
            protective = self.safety == SafetyMode.PROTECTIVE_STOP
            name = self.safety.name.lower().replace("_", " ")
            words = f"{name}: {self.stop_reason}" if protective else name
            return Hindrance(words, protective and self.stop_reason != BY_FAULT)
        if self.mode != RobotMode.RUNNING:
            return Hindrance(f"robot mode {self.mode.name}", False)
        return None

    @property
    def plays(self) -> bool:
        """Whether a program plays on an arm that may move."""
        return self.runtime == Runtime.PLAYING and self.hindrance(self.now) is None

    @property
    def pose_told(self) -> Pose:
        """Pose of the controller's tool, without noise."""
        return self.snapshots[-1].now

    def told(self, act: Act, words: str, taken: bool, moves: bool = True) -> None:
        """An order that tells no place came."""
        self.orders.tell(HeardOrder(self.now, act, words, taken, moves=moves))

    # --- programs

    @property
    def takes_programs(self) -> bool:
        """Whether text on the script port is taken."""
        return self.remote and self.mode == RobotMode.RUNNING and self.safety not in STOPPED_MODES

    def start_program(self, make: Callable[[], Program], in_time: bool = True) -> bool:
        """A whole program came; a running one is stopped first. False, and nothing else, where none is taken."""
        if not (in_time and self.takes_programs):
            self.counts["programs refused"] += 1
            return False
        self._end_program()
        self._starting = self.now + self.profile.start_delay_ms / 1000.0, make
        return True

    def stop_program(self) -> None:
        """Stop what plays, is paused, or has come and does not play yet; the arm brakes."""
        self.uploads.stops += 1
        self._end_program()

    def _end_program(self) -> None:
        if self.program is not None:
            self.program.close()
            self.console.tell(Saying(self.now, Message.STOPPED, self.program.name))
        self.program = self._starting = None
        self.watchdogs = []
        self.compliance.reset()
        self.runtime = Runtime.STOPPED

    def pause(self) -> bool:
        """Pause what plays; the arm brakes. False where nothing plays."""
        if self.runtime != Runtime.PLAYING:
            return False
        self.runtime = Runtime.PAUSED
        return True

    def play(self) -> bool:
        """Go on with what is paused. False where nothing is, or the robot may not move."""
        if self.runtime != Runtime.PAUSED or self.safety in STOPPED_MODES or self.mode != RobotMode.RUNNING:
            return False
        self.runtime = Runtime.PLAYING
        for watchdog in self.watchdogs:
            watchdog.last = self.now
        return True

    def watch_input(self, name: str, frequency_hz: float, action: str) -> None:
        """A program asks for a watchdog. Counting begins now."""
        if frequency_hz > 0.0:
            self.watchdogs.append(Watchdog(name, 1.0 / frequency_hz, action, self.now))

    def enable_external_force(self, enable: bool) -> None:
        """Take `external_force_torque` for the force sensor, or the arm's own."""
        self.external_force, self._force_at = enable, self.now

    def _watch(self, now: float) -> None:
        rate = self.profile.force_watchdog_hz
        if self.runtime != Runtime.PLAYING:
            return
        if self.external_force and rate and now - self._force_at > 1.0 / rate + 1e-9:
            self.counts["external force missing"] += 1
            self.pause()
            return
        for watchdog in self.watchdogs:
            if now - watchdog.last > watchdog.period + 1e-9:
                self.counts[f"watchdog {watchdog.action}"] += 1
                self._end_program() if watchdog.action == "stop" else self.pause()
                return

    # --- orders to the arm

    def order(self, order: Order) -> None:
        """A program orders the arm for this cycle."""
        if isinstance(order, Servo) and order.target != self._wanted:
            if not self._sound(order.target):
                return
            self._wanted = order.target
        if isinstance(order, Place) and not max(map(abs, order.target)) <= RANGE:
            self.protective_stop("a move beyond the end of a joint's range")
            return
        self.arm.take(order)

    def target_taken(self) -> None:
        """A program goes to another target from this cycle on."""
        self.path.taken()
        self.path.begins(self.now)

    def solve(self, pose: Pose, near: Joints | None = None) -> Joints | None:
        """Joints that hold the controller's tool in a pose; None where there are none."""
        return nearest(self.lengths, compose(pose, invert(self.tcp)), near or self.arm.target)

    def forward(self, joints: Joints, tcp: Pose | None = None) -> Pose:
        """Pose of the controller's tool at these joints."""
        return compose(flange(self.lengths, joints), tcp or self.tcp)

    def _sound(self, joints: Joints) -> bool:
        """Whether the next servo target is near enough to the last one; if not, it makes a protective stop."""
        old = self._wanted if isinstance(self.arm.order, Servo) else self.arm.joints
        problem = problem_of_target(self.profile, self.lengths, old, joints)
        if problem:
            self.protective_stop(problem)
        return not problem

    # --- safety

    def _guard(self) -> None:
        """Stop for what no arm may do, and hold it where it may not move."""
        profile, arm = self.profile, self.arm
        if self.safety not in STOPPED_MODES and self.mode == RobotMode.RUNNING:
            moved = math.dist(self._flange.position, self._old_flange.position)
            if max(map(abs, arm.motion)) > profile.max_joint_speed_rad_s:
                self.protective_stop(TOO_FAST)
            elif moved > profile.max_tcp_speed_mm_s * 1e-3 * self.period:
                self.protective_stop("the tool is too fast")
            elif self.external_force and math.hypot(*self.force.felt[:3]) > profile.max_force_n:
                self.protective_stop("the force is too large")
            elif max(map(abs, arm.joints)) > RANGE:
                self.protective_stop("a joint is at the end of its range")
        if self.safety in STOPPED_MODES or self.mode != RobotMode.RUNNING:
            arm.take(Hold())
        elif self.runtime != Runtime.PLAYING:
            arm.take(Brake(profile.stop_deceleration_rad_s2))

    def protective_stop(self, why: str) -> None:
        """The arm stands at once, and what plays is paused or stopped. Nothing in a graver stop."""
        if self.safety in STOPPED_MODES:
            return
        self.counts[f"protective stop: {why}"] += 1
        self.stop_reason = why
        self.safety, self.stopped_at = SafetyMode.PROTECTIVE_STOP, self.now
        if self.profile.on_protective_stop == "stopped" or not self.pause():
            self.stop_program()
        self.arm.take(Hold())

    def unlock_protective_stop(self) -> bool:
        """False where it is too early, or there is none."""
        early = self.now - self.stopped_at < self.profile.unlock_s - 1e-9
        if self.safety != SafetyMode.PROTECTIVE_STOP or early:
            return False
        self.safety = SafetyMode.NORMAL
        return True

    def emergency_stop(self, mode: SafetyMode = SafetyMode.ROBOT_EMERGENCY_STOP, by: str = "a fault") -> None:
        """The power goes, and the program. It holds until all that have pressed it have released it."""
        self.counts["emergency stop"] += 1
        self._emergency_stops.add(by)
        self.safety = mode
        self.power_off()

    def release_emergency_stop(self, by: str = "a fault") -> None:
        """The button is pulled; power and brakes stay as they are."""
        self._emergency_stops.discard(by)
        if not self._emergency_stops and self.safety in (
            SafetyMode.ROBOT_EMERGENCY_STOP,
            SafetyMode.SYSTEM_EMERGENCY_STOP,
        ):
            self.safety = SafetyMode.NORMAL

    def safeguard(self, is_open: bool) -> None:
        """A safeguard opens or closes."""
        if is_open and self.safety not in STOPPED_MODES:
            self.safety = SafetyMode.SAFEGUARD_STOP
            self.pause()
        elif not is_open and self.safety == SafetyMode.SAFEGUARD_STOP:
            self.safety = SafetyMode.NORMAL

    def power_off(self) -> None:
        """Power goes at once; brakes hold the arm."""
        self._powered += 1
        self.stop_program()
        self.mode = RobotMode.POWER_OFF
        self.arm.take(Hold())

    def power_on(self) -> bool:
        """It takes a while until it is idle. False where it is on, or stopped."""
        if self.mode != RobotMode.POWER_OFF or self.safety in STOPPED_MODES:
            return False
        self._become_later(RobotMode.IDLE)
        return True

    def release_brakes(self) -> bool:
        """It takes a while until it runs, and to be powered before. False where it is neither idle nor off."""
        off = self.mode == RobotMode.POWER_OFF
        if (off and not self.power_on()) or not (off or self.mode == RobotMode.IDLE):
            return False
        self._become_later(RobotMode.RUNNING, 2.0 if off else 1.0)
        return True

    def _become_later(self, mode: RobotMode, times: float = 1.0) -> None:
        """Come to a mode after so many times the usual one, unless the power goes before."""
        powered = self._powered

        def become() -> None:
            if self._powered == powered:
                self.mode = mode

        self.later(times * self.profile.power_s, become)

    @property
    def still(self) -> bool:
        """Whether the arm stands."""
        return self.arm.still or self.arm.speeds == ZERO
