"""Reports of the emulated controller, which faults may falsify."""

import math

import numpy as np

from emulators.arm.own_force import Errors, OwnForce
from emulators.arm.reported_pose import ReportedPose
from emulators.faults.own import OwnFaults
from hil_fanuc.arms import Joints, to_pendant
from hil_fanuc.motion import Motion
from hil_fanuc.packets import (
    NO_SENSOR,
    CommandPosition,
    ContactStop,
    Nine,
    Report,
    RobotStatus,
    Status,
    nine,
)
from hil_fanuc.profile import FanucProfile
from hil_fanuc.program import Program
from hil_fanuc.stream_server import HAS_FORCE, StreamServer
from protocol.geometry import Pose, Wrench, angles_of, inverse, rotate

_NO_NUMBERS: Nine = (math.nan,) * 9
_RATE_MAX = 15
_LAG_S = 0.01
"""Time constant of the filter of the reported force, s. Assumed: as for other sensors at the wrist."""


class Reporter:
    """Composer of the reports of one controller."""

    def __init__(
        self, profile: FanucProfile, motion: Motion, program: Program, server: StreamServer, seed: int
    ) -> None:
        self._profile, self._motion, self._program, self._server = profile, motion, program, server
        self.pose = ReportedPose(self._measured)
        self.force = OwnForce(
            Errors(
                profile.force_offset_n,
                _LAG_S,
                noise=(*(profile.force_noise_n,) * 3, 0.0, 0.0, 0.0),
                moving=(*(profile.force_noise_n,) * 3, 0.0, 0.0, 0.0),
                turns=True,
            ),
            seed,
        )
        self.faults = OwnFaults()
        self.contact_stop = ContactStop.NONE
        self._shift_s = 0.0
        """Shift of the time stamps by faults, s."""
        self._zero = (0.0, 0.0, 0.0)
        self._zeroes = 0
        self._clock_begin = 0.0

    def begin(self, now: float) -> None:
        """Start the controller's clock."""
        self._clock_begin = now

    def shift_clock(self, seconds: float) -> None:
        """Let the clock of the time stamps jump."""
        self._shift_s += seconds

    def _measured(self, at: float) -> Pose:
        """Return the pose of the tool at a past time, base frame."""
        times = np.array([at])
        x, y, z = self._motion.path.trajectory(times)[0][0].tolist()
        return Pose((x, y, z), self._motion.path.orientations(times)[0][1])

    def report(self, now: float) -> Report:
        """Return the report of the cycle that begins now."""
        motion, program, server = self._motion, self._program, self._server
        joints, pose = motion.joints, motion.path.pose
        reported = self.pose.told(pose, now) if self.pose.wrong else pose
        numbers, angles = self._numbers(reported), self._in_packets(joints)
        if reported is None or math.isnan(reported.position[0]):
            angles = _NO_NUMBERS if reported is None else self._in_packets(joints)
        elif reported != pose:
            angles = self._in_packets(motion.arm.nearest(reported, joints) or joints)
        status = Status.SYSTEM_READY if program.servo_on else Status(0)
        status |= Status.READY if program.is_ready(now) else Status(0)
        status |= Status.RECEIVED if server.received else Status(0)
        fastest = motion.fastest_deg_s
        status |= Status.MOVING if fastest > self._profile.in_motion_deg_s else Status(0)
        server.received = False
        rate = min(self._profile.cycle_ms, _RATE_MAX)
        return Report(
            server.version,
            server.sequence,
            int(status) | rate << 4,
            now - self._clock_begin + self._shift_s,
            numbers,
            angles,
            robot_status=self._robot_status(now),
            contact_stop=self.contact_stop,
            wrench=self._wrench(pose, fastest > self._profile.in_motion_deg_s, now),
            sensor=server.sensor if server.has_sensor or not server.sensor else NO_SENSOR,
        )

    def set_point(self, now: float) -> CommandPosition:
        """Return the newest set point."""
        motion = self._motion
        joints = motion.set_point
        pose = self._numbers(motion.arm.pose(joints))
        return CommandPosition(
            self._server.version, now - self._clock_begin + self._shift_s, pose, self._in_packets(joints)
        )

    def _in_packets(self, joints: Joints) -> Nine:
        """Return joints as packets contain them."""
        return nine(to_pendant(joints) if self._profile.stream_j3 == "horizon" else joints)

    def _robot_status(self, now: float) -> int:
        program = self._program
        status = RobotStatus.ERROR if program.alarms else RobotStatus(0)
        status |= RobotStatus.PENDANT if program.pendant_on else RobotStatus(0)
        status |= RobotStatus.EMERGENCY_STOP if program.reports_stop(now) else RobotStatus(0)
        return int(status)

    def _numbers(self, pose: Pose | None) -> Nine:
        """Return the pose of the reported point as X Y Z in mm and W P R in degrees, world frame."""
        if pose is None:
            return _NO_NUMBERS
        arm = self._motion.arm
        world = arm.in_world(pose if self._server.reports_tcp else arm.flange_of(pose))
        x, y, z = world.position
        r, p, w = angles_of(world.quaternion)
        return nine((1e3 * x, 1e3 * y, 1e3 * z, w, p, r))

    def _wrench(self, pose: Pose, moves: bool, now: float) -> Wrench | None:
        """Return the reported force and moment; None before version 4. Without a selected sensor, they are zero."""
        server = self._server
        if server.version < HAS_FORCE:
            return None
        x, y, z, *moments = self.force.at(now, moves, pose.quaternion)
        if server.zeroes != self._zeroes:
            self._zeroes, self._zero = server.zeroes, rotate(inverse(pose.quaternion), self.force.level[:3])
        if not server.has_sensor or self.faults.under_way("missing", now):
            return (0.0,) * 6
        force = rotate(inverse(pose.quaternion), (x, y, z))
        a, b, c = (part - zero for part, zero in zip(force, self._zero, strict=True))
        if self._profile.force_axes == "base":
            a, b, c = rotate(pose.quaternion, (a, b, c))
        k, m, n = moments
        return a, b, c, k, m, n
