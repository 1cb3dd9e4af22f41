"""The drives of an arm, which follow the controller's targets, and its encoders, which tell where they are.

Recordings of real arms give two figures: how late a joint comes behind its target, and how large a difference remains.
The difference is slow, as of friction. Here it is a wave whose frequency changes at random. It has a bound, as friction
has, and goes away where the joint stands: before the motion of lbusellato/CoLeCT all joints were within 40 µrad of
their targets, with their noise. Assumed: that form.
"""

import math
from collections import deque
from operator import mul

from emulators.arm.noise_rows import NoiseRows
from emulators.arm.own_force import Errors, Slow
from emulators.devices.rtde.arm import ZERO
from emulators.devices.rtde.kinematics import Joints
from emulators.devices.rtde.profile import RtdeProfile
from protocol.geometry import Vector

_PEAK = math.sqrt(2.0)
"""Derived: height of a wave by its root mean square."""
_GONE = 1e-9
"""Chosen: a smaller difference is none, rad."""
_RATE = 2.0
"""Chosen: root mean square of the change of a phase over `follow_error_ms`, rad; a wave of 0.3 s, as was recorded."""
_TOLD_RAD_S = 5e-4
"""Observed (lbusellato/CoLeCT): a joint whose target moves by 0.45 mrad/s tells 0, one of 0.55 its speed."""
_GRAVITY = -9.82
"""Assumed: what the tool's accelerometer tells along its z axis, m/s²."""
_FAST_RAD_S = 1.0
"""The speed at which `fast_follow_error_urad` holds."""


class Drives:
    """Joints as they are, behind those that the controller wants."""

    def __init__(self, profile: RtdeProfile, joints: Joints, seed: int) -> None:
        """At rest at these joints, rad."""
        self.joints = joints
        """At the end of the newest cycle, rad."""
        self.speeds = ZERO
        """Over that cycle, rad/s."""
        self._period = profile.cycle_ms * 1e-3
        self._waiting = deque([joints] * profile.follow_delay_cycles, profile.follow_delay_cycles)
        """Targets that are under way; the newest comes last."""
        self._slow_error = profile.follow_error_urad * 1e-6
        self._more_error = max(0.0, profile.fast_follow_error_urad * 1e-6 - self._slow_error) / _FAST_RAD_S
        self._time = profile.follow_error_ms * 1e-3
        """In which the differences become others, s."""
        self._noise, self._number = NoiseRows(seed, "drives"), 0
        self._slow = profile.slow_joint_mrad_s * 1e-3
        self._sizes = [0.0] * 6
        """Of the differences, root mean square, rad."""
        self._wanders = False
        """Whether a joint is off its target."""
        self._phases, self._rates = [0.0] * 6, [0.0] * 6
        """Of the waves that the differences go by, rad, and their changes over that time."""
        self._errors = [0.0] * 6
        """Differences from the targets, rad."""

    def step(self, target: Joints, held: bool = False) -> Joints:
        """Where the joints are at the end of a cycle whose target is this one, rad; brakes hold them where they are."""
        before, last = self.joints, self._waiting[0]
        self._waiting.append(target)
        target = self._waiting[0]
        if held:
            self.speeds = ZERO
            return before
        if target != last or self._wanders:
            self._wander([abs(new - old) / self._period for new, old in zip(target, last, strict=True)])
        a, b, c, d, e, f = [to + error for to, error in zip(target, self._errors, strict=True)]
        self.joints = joints = a, b, c, d, e, f
        if joints == before:
            self.speeds = ZERO
        else:
            dt = self._period
            a, b, c, d, e, f = [(new - old) / dt for new, old in zip(joints, before, strict=True)]
            self.speeds = a, b, c, d, e, f
        return joints

    def _wander(self, speeds: list[float]) -> None:
        """Drift the errors of joints that move, and remove those of joints that do not."""
        row = self._noise.row(self._number)
        self._number += 1
        passed = min(1.0, self._period / self._time) if self._time else 1.0
        for joint, (speed, normal) in enumerate(zip(speeds, row, strict=True)):
            moves = min(1.0, speed / self._slow)
            share = passed * moves
            size = self._sizes[joint] + passed * (
                moves * (self._slow_error + self._more_error * speed) - self._sizes[joint]
            )
            self._sizes[joint] = size if size > _GONE else 0.0
            self._rates[joint] += math.sqrt(2.0 * share) * _RATE * normal - share * self._rates[joint]
            self._phases[joint] += share * self._rates[joint]
            self._errors[joint] = _PEAK * self._sizes[joint] * math.sin(self._phases[joint])
        self._wanders = any(self._sizes)


class ArmSensors:
    """What is told of the joints and their drives: with noise, and in steps."""

    def __init__(self, profile: RtdeProfile, seed: int) -> None:
        self._noise_rad = profile.joint_noise_urad * 1e-6
        self._step_rad = 2.0 * math.pi / 2**profile.joint_bits if profile.joint_bits else 0.0
        self._noise_rad_s, self._slow = (
            profile.joint_speed_noise_mrad_s * 1e-3,
            profile.slow_joint_mrad_s * 1e-3,
        )
        self._rms_a, self._rms_m_s2 = profile.current_noise_a, profile.accelerometer_noise_m_s2
        self._places, self._speeds = NoiseRows(seed, "encoders"), NoiseRows(seed, "joint speeds")
        self._currents, self._accelerations = NoiseRows(seed, "currents"), NoiseRows(seed, "accelerations")

    def read(self, joints: Joints, number: int) -> Joints:
        """Joints as they are told in a cycle of this number, rad."""
        if rms := self._noise_rad:
            row = self._places.row(number)
            a, b, c, d, e, f = [joint + rms * normal for joint, normal in zip(joints, row, strict=True)]
            joints = a, b, c, d, e, f
        if step := self._step_rad:
            a, b, c, d, e, f = [step * round(joint / step) for joint in joints]
            joints = a, b, c, d, e, f
        return joints

    def read_speeds(self, speeds: Joints, number: int) -> Joints:
        """Speeds as they are told, rad/s: that of a joint at rest, or nearly, is 0."""
        if speeds is ZERO:
            return ZERO
        rms, slow, row = self._noise_rad_s, self._slow, self._speeds.row(number)
        a, b, c, d, e, f = [
            speed + rms * min(abs(speed), slow) / slow * normal if abs(speed) >= _TOLD_RAD_S else 0.0
            for speed, normal in zip(speeds, row, strict=True)
        ]
        return a, b, c, d, e, f

    def read_currents(self, number: int) -> Joints:
        """Currents of a powered arm, A: noise alone."""
        a, b, c, d, e, f = map(mul, self._rms_a, self._currents.row(number))
        return a, b, c, d, e, f

    def read_acceleration(self, number: int) -> Vector:
        """Acceleration of the tool, m/s²: that of gravity in one place, with noise."""
        x, y, z = map(mul, self._rms_m_s2, self._accelerations.row(number))
        return x, y, z + _GRAVITY


def own_errors(profile: RtdeProfile) -> Errors:
    """Errors of the force that the arm feels by itself."""
    return Errors(
        profile.force_offset_n,
        profile.force_lag_ms * 1e-3,
        (*profile.force_noise_n, *profile.force_noise_nm),
        (*profile.moving_force_noise_n, *profile.moving_force_noise_nm),
        profile.force_walk_n,
        profile.force_slope_n_min,
        profile.force_offset_axes == "flange",
        Slow(profile.force_warm_up_n, profile.force_warm_up_s),
        Slow(profile.force_creep_share, profile.force_creep_s),
    )
