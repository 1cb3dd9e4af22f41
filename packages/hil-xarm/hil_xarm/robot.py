"""Emulated robot that a cell uses: a control box with its arm, its faults and its connections."""

import math

from emulators.faults.ledger import Handler, Injection
from emulators.faults.packets import WIRE
from emulators.orders import Act, Hindrance, ReceivedOrder
from emulators.seams import ArmPath, ContactSource, Handlers, Joints, StartPose
from hil_xarm.arms import JOINT_STIFFNESS, MODE
from hil_xarm.box import Box
from hil_xarm.cable import Cable, Server
from hil_xarm.codes import Error
from hil_xarm.connections import CommandConnection, ReportConnection, Stalls
from hil_xarm.faults import XARM_FAULTS
from hil_xarm.force import ForceSensor
from hil_xarm.frames import State
from hil_xarm.profile import XarmProfile
from hil_xarm.reports import Port
from protocol.arm_size import PerAxis
from protocol.geometry import Pose


class XarmRobot:
    """Robot with any number of client connections. An `EmulatedRobot`."""

    def __init__(self, profile: XarmProfile, start: StartPose, now: float, seed: int) -> None:
        """Power up at `now`. Raises ValueError for a start that the arm cannot hold."""
        self.box = box = Box(profile, start, now)
        self.path: ArmPath = box.motion.path
        self.targets = box.motion.path.targets
        self.orders, self.unmodelled = box.orders, box.unmodelled
        self.cable = Cable(f"{seed} robot")
        self._stalls = Stalls(box, seed)
        self._open = dict.fromkeys(Port, 0)
        self._powered_at = now

    @property
    def handlers(self) -> Handlers:
        box = self.box
        acts = {
            "servo-error": lambda at: box.fail(Error.JOINT),
            "speed-error": lambda at: box.fail(box.profile.speed_error),
            "collision": lambda at: box.fail(Error.COLLISION),
            "stopped": lambda at: box.set_state(State.STOPPED),
            "mode-changed": lambda at: box.set_mode(0),
            "power-cycle": box.cycle_power,
        }
        return {
            "robot": {
                "emergency-stop": Handler(self._press, lambda injection, now: box.release_stop()),
                "paused": Handler(self._pause, lambda injection, now: box.set_state(State.MOVE)),
                "lags": Handler(self._lag, lambda injection, now: box.motion.loops.delay(0.0)),
                **box.faults.striking(acts),
                **box.faults.held(("stalls", "stands", "mute")),
            },
            "pose": {name: box.reported.handlers[name] for name in XARM_FAULTS["pose"]},
            WIRE: self.cable.handlers,
        }

    def _press(self, injection: Injection) -> None:
        injection.strike(injection.injected_at)
        self.box.press_stop(injection.injected_at)

    def _pause(self, injection: Injection) -> None:
        injection.strike(injection.injected_at)
        self.box.set_state(State.PAUSED)

    def _lag(self, injection: Injection) -> None:
        injection.strike(injection.injected_at)
        self.box.motion.loops.delay(injection.number("ms") / 1e3)

    # --- as an emulated robot

    @property
    def endpoint(self) -> Server:
        """Another connection to the command channel."""
        return self.cable.open(CommandConnection(self.box, self._stalls), Port.COMMAND, self._powered_at)

    @property
    def joint_stiffness(self) -> PerAxis:
        return JOINT_STIFFNESS

    @property
    def mode(self) -> tuple[float, float]:
        return MODE

    def tool_pose_at(self, joints: PerAxis) -> Pose:
        a, b, c, d, e, f = map(math.degrees, joints)
        return self.box.motion.chain.pose((a, b, c, d, e, f))

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        joints = self.box.motion.chain.nearest(pose, self.box.motion.joints)
        return None if joints is None else tuple(map(math.radians, joints))

    def feel(self, contact: ContactSource) -> None:
        self.box.feel(contact)

    def equip(self, sensor: object) -> None:
        if isinstance(sensor, ForceSensor):
            self.box.sensor, sensor.robot = sensor, self

    def hindrance(self, now: float) -> Hindrance | None:
        return self.box.hindrance(now)

    # --- connections

    def connect(self, port: Port, now: float, sensor: ForceSensor | None = None) -> Server | None:
        """Open a client's connection to a port; with `sensor`, over the cable of its client. None if the port serves as
        many clients as it can.
        """
        if self._open[port] >= self.box.profile.clients:
            self.box.counts["clients refused"] += 1
            return None
        self._open[port] += 1
        inner: CommandConnection | ReportConnection
        if port is Port.COMMAND:
            inner = CommandConnection(self.box, self._stalls)
        else:
            inner = ReportConnection(self.box, port, now, None if sensor is None else sensor.report)
        if sensor is not None:
            return sensor.cable.open(inner, port, now)
        self.box.report_order(ReceivedOrder(now, Act.CONTACT, f"connection to the {port} port", True))
        return self.cable.open(inner, port, now)

    def leave(self, port: Port, server: Server, now: float) -> None:
        """End a connection."""
        self._open[port] -= 1
        server.close(now)
