"""Emulated control box: its state, its arm, and the force sensor that it reads.

Order of a session: enable the motors, set the mode, set the state to move. After an error the arm is stopped; the error
must be cleared, and mode and state set again. In servo mode, only the newest target counts, in each control cycle.
"""

import math
from collections import Counter, deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from emulators.arm.reported_pose import ReportedPose
from emulators.faults.own import OwnFaults
from emulators.orders import Hindrance, Orders, ReceivedOrder
from emulators.seams import ContactSource, StartPose
from emulators.unmodelled import Unmodelled
from hil_xarm.codes import Error, Warning, error_text
from hil_xarm.frames import Mode, State
from hil_xarm.motion import Motion
from hil_xarm.profile import XarmProfile
from protocol.arm_size import PerAxis
from protocol.geometry import Pose, Vector, inverse, product, rotate

if TYPE_CHECKING:
    from hil_xarm.force import ForceSensor

QUEUE_MAX = 256
"""Number of planned motions that the box keeps. Assumed."""
_PASSED_S = 1e-6
"""Age at which the contact force is read, s. Chosen: the path up to that time is committed."""
_NOWHERE = Pose((math.nan,) * 3, (1.0, 0.0, 0.0, 0.0))
_STOPS = (Error.STOP_BUTTON, Error.STOP_INPUT)
_BY_ORDER = (Error.KINEMATICS, Error.JOINT_LIMIT, Error.SPEED, Error.PLANNING, Error.SERVO_SPEED)
"""Errors that a command of a client causes."""


class Box:
    """Control box with an arm."""

    def __init__(self, profile: XarmProfile, start: StartPose, now: float) -> None:
        """Power up at `now`. Raises ValueError for a start that the arm cannot hold."""
        self.profile = profile
        self.motion = Motion(profile, start, now, self._decide)
        self.orders = Orders()
        self.unmodelled = Unmodelled("xarm")
        self.counts: Counter[str] = Counter()
        self.faults = OwnFaults()
        self.reported = ReportedPose(self._measured)
        self.sensor: ForceSensor | None = None
        self.powered_at = now
        self.mode: int = Mode.POSITION
        self.error: int = Error.NONE
        self.warning: int = Warning.NONE
        self.is_enabled = False
        self.stop_pressed = False
        self.tcp_offset = Pose((0.0, 0.0, start.tool_length), (1.0, 0.0, 0.0, 0.0))
        """Tool centre point in the frame of the flange, as set in the box."""
        self.load: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
        """Mass, kg, and centre of gravity, mm, as set in the box."""
        self.collision_sensitivity, self.teach_sensitivity = 3, 3
        self._state: int = State.STOPPED
        """State that was set: MOVE, PAUSED, STOPPED or MODE_CHANGED."""
        self._target: PerAxis | None = None
        """Newest servo target, not taken yet."""
        self._queue: deque[Callable[[], object]] = deque()
        self._contact: ContactSource | None = None

    # --- state

    @property
    def state(self) -> int:
        """Reported state."""
        if self._state != State.MOVE:
            return self._state
        return State.ASLEEP if self.motion.is_done and not self._queue else State.MOVING

    @property
    def is_ready(self) -> bool:
        """Whether the arm follows motion commands."""
        return self.is_enabled and not self.error and self._state in (State.MOVE, State.PAUSED)

    @property
    def queued(self) -> int:
        """Number of motions in the queue, including the one in progress."""
        is_busy = self.mode == Mode.POSITION and not self.motion.is_done
        return len(self._queue) + is_busy

    def advance(self, now: float) -> None:
        """Compute the arm up to now."""
        self.motion.path.advance(now)

    def enable(self, is_on: bool) -> None:
        """Switch the motors on or off."""
        if self.stop_pressed and is_on:
            return
        self.is_enabled = is_on
        if not is_on:
            self._stop(State.STOPPED)
            self.motion.lock()

    def set_state(self, state: int) -> bool:
        """Set the state; return False for a number without meaning."""
        match state:
            case State.MOVE:
                if self.is_enabled and not self.error:
                    self._state = State.MOVE
            case State.PAUSED:
                if self._state == State.MOVE:
                    self._state = State.PAUSED
                    self.motion.halt()
            case State.STOPPED | State.SLOW_STOP:
                self._stop(State.STOPPED)
            case _:
                return False
        return True

    def set_mode(self, mode: int) -> None:
        """Set the mode. The arm stops, and the state must be set again."""
        if not self.error:
            self._stop(State.MODE_CHANGED)
        self.mode = mode

    def fail(self, error: int) -> None:
        """Stop the arm with an error."""
        if not self.error or error in _STOPS:
            self.error = error
        self._stop(State.STOPPED)

    def clear_error(self) -> None:
        """Clear the error, unless its cause persists."""
        if not self.stop_pressed:
            self.error = Error.NONE

    def press_stop(self, now: float) -> None:
        """Press the emergency stop: the motors are switched off."""
        self.advance(now)
        self.stop_pressed, self.is_enabled = True, False
        self.fail(Error.STOP_BUTTON)

    def release_stop(self) -> None:
        """Release the emergency stop; its error remains."""
        self.stop_pressed = False

    def cycle_power(self, now: float) -> None:
        """Switch the box off and on."""
        self.advance(now)
        self.motion.lock()
        self._stop(State.STOPPED)
        self.error, self.warning, self.mode = Error.NONE, Warning.NONE, Mode.POSITION
        self.is_enabled = False
        if self.stop_pressed:
            self.fail(Error.STOP_BUTTON)
        if self.sensor is not None:
            self.sensor.is_on = self.profile.sensor_on

    def _stop(self, state: int) -> None:
        self._state, self._target = state, None
        self._queue.clear()
        self.motion.halt()

    def report_order(self, order: ReceivedOrder) -> None:
        """Report an order to the judge."""
        self.orders.tell(order)

    def hindrance(self, now: float) -> Hindrance | None:
        """Return why servo targets do not move the arm; None if they do."""
        if self.faults.holds("stands", now):
            return Hindrance("the arm is stopped", False)
        if self.error:
            return Hindrance(error_text(self.error), self.error in _BY_ORDER)
        return None

    # --- motions

    def servo(self, joints: PerAxis | None, now: float) -> None:
        """Take a servo target; None for one that no joints reach."""
        if not self.is_ready or self._state != State.MOVE or self.mode != Mode.SERVO:
            self.counts["servo commands without effect"] += 1
            return
        if joints is None:
            self.fail(Error.KINEMATICS)
        elif not self.motion.chain.allows(joints):
            self.fail(Error.JOINT_LIMIT)
        else:
            if self._target is not None:
                self.counts["servo commands lost"] += 1
            self._target = joints
            self.motion.path.targets.accept(now)

    def plan(self, motion: Callable[[], object]) -> bool:
        """Queue a planned motion; return False if the box does not follow it."""
        if not self.is_ready or self.mode != Mode.POSITION:
            return False
        if len(self._queue) >= QUEUE_MAX:
            self.warning = Warning.QUEUE_FULL
            return False
        self._queue.append(motion)
        return True

    def _decide(self, at: float) -> None:
        """Set the targets of the cycle that begins at a time."""
        limit = self.profile.tool_speed_mm_s / 1e3
        if self.mode == Mode.SERVO and self._state == State.MOVE and self.motion.tool_speed > limit:
            self.fail(self.profile.speed_error)
        if self.faults.under_way("stands", at):
            self.motion.lock()
            self._target = None
        if self._state != State.MOVE:
            return
        if self._target is not None:
            self.motion.aim(self._target)
            self.motion.path.targets.begin_newest(at + self.motion.loops.delay_s)
            self._target = None
        elif self._queue and self.motion.is_done:
            self._queue.popleft()()

    # --- poses and forces

    def pose_of(self, joints: PerAxis) -> Pose:
        """Return the pose of the tool centre point that is set in the box, base frame."""
        flange, offset = self.motion.chain.flange(joints), self.tcp_offset
        x, y, z = rotate(flange.quaternion, offset.position)
        u, v, w = flange.position
        return Pose((u + x, v + y, w + z), product(flange.quaternion, offset.quaternion))

    def joints_of(self, pose: Pose) -> PerAxis | None:
        """Return the joints that hold the tool centre point of the box in a pose, near the present ones."""
        turned = product(pose.quaternion, inverse(self.tcp_offset.quaternion))
        x, y, z = rotate(turned, self.tcp_offset.position)
        u, v, w = pose.position
        chain = self.motion.chain
        return chain.nearest(chain.tip_of(Pose((u - x, v - y, w - z), turned)), self.motion.set_point)

    def reported_pose(self, now: float) -> tuple[Pose, PerAxis]:
        """Return the pose and the joints that the box reports, which faults may falsify."""
        joints = self.motion.joints
        pose = self.pose_of(joints)
        if not self.reported.wrong:
            return pose, joints
        wrong = self.reported.told(pose, now)
        if wrong is None or math.isnan(wrong.position[0]):
            return _NOWHERE, (math.nan,) * 6
        return wrong, (self.joints_of(wrong) or joints) if wrong != pose else joints

    def _measured(self, at: float) -> Pose:
        times = np.array([at])
        x, y, z = self.motion.path.trajectory(times)[0][0].tolist()
        return Pose((x, y, z), self.motion.path.orientations(times)[0][1])

    def feel(self, contact: ContactSource) -> None:
        """Set the source of the true contact force."""
        self._contact = contact

    def contact(self, now: float) -> Vector:
        """Return the contact force, N, base frame, and stop the arm if it is a collision."""
        if self._contact is None:
            return 0.0, 0.0, 0.0
        force = self._contact(max(now - _PASSED_S, self.powered_at))
        if self.profile.collision_n and math.hypot(*force) > self.profile.collision_n and self.is_enabled:
            self.fail(Error.COLLISION)
        return force

    def watch_sensor(self, now: float) -> None:
        """Stop the arm with the error of the force sensor, if it has one."""
        if self.sensor is not None and (error := self.sensor.find_error(now)):
            self.fail(error)
