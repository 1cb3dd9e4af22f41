"""Emulated robot that a cell or a room uses: the controller with its faults, and its servers."""

from collections.abc import Mapping

from emulators.arm.mode import Mode
from emulators.devices.rtde.cable import Cable, Inner, Server
from emulators.devices.rtde.connection import Connection
from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.dashboard import Dashboard, Settings
from emulators.devices.rtde.disturbance import Disturbance
from emulators.devices.rtde.kinematics import Joints
from emulators.devices.rtde.primary import PrimaryPort
from emulators.devices.rtde.profile import RtdeProfile
from emulators.devices.rtde.program_socket import ProgramSocket
from emulators.devices.rtde.realtime import RealtimePort
from emulators.devices.rtde.script import ScriptPort
from emulators.devices.rtde.stiffness import JOINT_STIFFNESS, MODE
from emulators.orders import Act, ReceivedOrder
from emulators.seams import ArmPath, Handlers, RobotFactory, StartPose
from protocol.devices.rtde.wires import Port
from protocol.geometry import Pose

CLIENTS_MAX = 16
"""Maximum number of simultaneous connections to one port. Chosen: the limit of a real controller is not published."""


class RtdeRobot:
    """Robot with any number of client connections. An `EmulatedRobot`."""

    def __init__(self, profile: RtdeProfile, start: StartPose, now: float, seed: int) -> None:
        """Create the robot. Raises ValueError for a start that its arm cannot hold."""
        self.controller = controller = Controller(profile, start, now, seed)
        self._cable = Cable(seed)
        self._disturbance = Disturbance(controller, self._cable.handlers, self._cable.program_handlers)
        self.path: ArmPath = controller.path
        self.handlers: Handlers = self._disturbance.handlers
        self.targets = controller.path.targets
        self.orders, self.hindrance = controller.orders, controller.state.hindrance
        self.unmodelled = controller.unmodelled
        self.feel, self.carry = controller.force.feel, controller.force.carry
        self._open = dict.fromkeys(Port, 0)
        self._settings = Settings()

    @property
    def endpoint(self) -> Server:
        """Open another connection to the RTDE port."""
        return self._serve(Port.RTDE, self.controller.now)

    @property
    def joint_stiffness(self) -> Joints:
        return JOINT_STIFFNESS[self.controller.profile.model]

    @property
    def mode(self) -> Mode:
        return MODE[self.controller.profile.model]

    def tool_pose_at(self, joints: Joints) -> Pose:
        manipulator = self.controller.manipulator
        return manipulator.forward(joints, manipulator.tool)

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        return self.controller.manipulator.joints_holding(pose)

    def connect(self, port: Port, now: float) -> Server | None:
        """Open a client's connection to a port. Return None if the port has too many connections."""
        limit = self.controller.profile.max_clients if port is Port.RTDE else 0
        if self._open[port] >= (limit or CLIENTS_MAX):
            self.controller.counts["clients refused"] += 1
            return None
        self._open[port] += 1
        self.orders.tell(ReceivedOrder(now, Act.CONTACT, f"connection to {port}", True))
        return self._serve(port, now)

    def connect_program(self, now: float) -> tuple[Server, ProgramSocket]:
        """Open a connection of a program. Return its end behind the cable, and the socket that the program uses."""
        inner = ProgramSocket(self.controller)
        return self._cable.open(inner, now), inner

    def leave(self, port: Port, server: Server, now: float) -> None:
        """End the connection."""
        self._open[port] -= 1
        server.close(now)

    def _serve(self, port: Port, now: float) -> Server:
        inner: Inner
        match port:
            case Port.RTDE:
                inner = Connection(self.controller, self._disturbance, now)
            case Port.DASHBOARD:
                inner = Dashboard(self.controller, self._settings)
            case Port.SCRIPT:
                inner = ScriptPort(self.controller)
            case Port.PRIMARY | Port.READ_ONLY | Port.SECONDARY | Port.SECONDARY_READ_ONLY:
                inner = PrimaryPort(self.controller, self._disturbance.silences, now, port)
            case Port.REALTIME | Port.REALTIME_READ_ONLY:
                read_only = port is Port.REALTIME_READ_ONLY
                inner = RealtimePort(self.controller, self._disturbance, now, read_only)
        return self._cable.open(inner, now)


def make_robot(profile: RtdeProfile, programs: Mapping[str, bytes] | None = None) -> RobotFactory:
    """Return a factory of robots with these settings and stored programs."""

    def make(start: StartPose, now: float, seed: int) -> RtdeRobot:
        robot = RtdeRobot(profile, start, now, seed)
        robot.controller.player.stored = programs or {}
        return robot

    return make
