"""Drives of an arm, which follow the controller's targets, and encoders, which measure the joints.

Recordings of real arms give two figures: the delay between a joint and its target, and the size of the remaining
difference. The difference varies slowly, as friction does. Here it is a wave with a randomly varying frequency. It
is bounded, as friction is, and vanishes for a stationary joint: before the motion in lbusellato/CoLeCT, all joints
were within 40 µrad of their targets, noise included. Assumed: the form of the wave.
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
"""Amplitude of a wave relative to its root mean square. Derived."""
_NEGLIGIBLE_RAD = 1e-9
"""Difference from a target below which the difference counts as zero, rad. Chosen."""
_RATE, _SPREAD, _SMOOTHING = 1.5, 1.4, 0.5
"""Mean change of a phase over `follow_error_ms` and the largest difference from it, rad, and time constant of the
smoothing of that change, relative to `follow_error_ms`. Derived: correlation and spectrum are then nearly as in
lbusellato/CoLeCT, where half of the power lies between 2 and 4 Hz. The wave of at most 4.6 Hz does not excite the arm's
mode. The recorded encoders are behind the gears, so that the recorded 13 % above 6 Hz contain the mode's own motion.
"""
_LEAST_REPORTED_RAD_S = 5e-4
"""Speed from which a joint reports its speed instead of 0, rad/s. Observed (lbusellato/CoLeCT): a joint whose
target moves at 0.45 mrad/s reports 0, and one at 0.55 mrad/s reports its speed.
"""
_GRAVITY = -9.82
"""Reading of the tool's accelerometer along its z axis, m/s². Assumed."""
_FAST_RAD_S = 1.0
"""Joint speed at which `fast_follow_error_urad` applies, rad/s."""


class Drives:
    """Drives of an arm. The actual joint angles follow the targets of the controller."""

    def __init__(self, profile: RtdeProfile, joints: Joints, seed: int) -> None:
        """Start stationary at these joint angles, rad."""
        self.joints = joints
        """Joint angles at the end of the newest cycle, rad."""
        self.speeds = ZERO
        """Joint speeds during the newest cycle, rad/s."""
        self._period = profile.cycle_ms * 1e-3
        self._waiting = deque([joints] * profile.follow_delay_cycles, profile.follow_delay_cycles)
        """Targets that are still delayed, newest last."""
        self._slow_error = profile.follow_error_urad * 1e-6
        self._more_error = max(0.0, profile.fast_follow_error_urad * 1e-6 - self._slow_error) / _FAST_RAD_S
        self._time = profile.follow_error_ms * 1e-3
        """Correlation time of the differences from the targets, s."""
        self._noise, self._number = NoiseRows(seed, "drives"), 0
        self._slow = profile.slow_joint_mrad_s * 1e-3
        self._sizes = [0.0] * 6
        """Root mean square of the differences from the targets, rad."""
        self._deviates = False
        """Whether any joint deviates from its target."""
        self._phases, self._rates, self._smoothed = [0.0] * 6, [0.0] * 6, [0.0] * 6
        """Phases of the waves of the differences, rad, and random numbers that vary the changes of these phases, before
        and after smoothing.
        """
        self._errors = [0.0] * 6
        """Differences from the targets, rad."""

    def step(self, target: Joints, held: bool = False) -> Joints:
        """Return the joint angles at the end of a cycle with this target, rad. Brakes hold the current joint angles."""
        before, last = self.joints, self._waiting[0]
        self._waiting.append(target)
        target = self._waiting[0]
        if held:
            self.speeds = ZERO
            return before
        if target != last or self._deviates:
            self._vary_errors([abs(new - old) / self._period for new, old in zip(target, last, strict=True)])
        a, b, c, d, e, f = [to + error for to, error in zip(target, self._errors, strict=True)]
        self.joints = joints = a, b, c, d, e, f
        if joints == before:
            self.speeds = ZERO
        else:
            dt = self._period
            a, b, c, d, e, f = [(new - old) / dt for new, old in zip(joints, before, strict=True)]
            self.speeds = a, b, c, d, e, f
        return joints

    def _vary_errors(self, speeds: list[float]) -> None:
        """Vary the differences of moving joints, and reduce the differences of stationary joints to zero."""
        row = self._noise.row(self._number)
        self._number += 1
        passed = min(1.0, self._period / self._time) if self._time else 1.0
        sizes, rates, smoothed, phases = self._sizes, self._rates, self._smoothed, self._phases
        for joint, (speed, normal) in enumerate(zip(speeds, row, strict=True)):
            moves = speed / self._slow if speed < self._slow else 1.0
            share = passed * moves
            size = sizes[joint]
            size += passed * (moves * (self._slow_error + self._more_error * speed) - size)
            sizes[joint] = size = size if size > _NEGLIGIBLE_RAD else 0.0
            rates[joint] += math.sqrt(2.0 * share) * normal - share * rates[joint]
            smoothing = min(1.0, share / _SMOOTHING)
            smoothed[joint] += smoothing * (rates[joint] - smoothed[joint])
            phases[joint] += share * (_RATE + _SPREAD * math.tanh(smoothed[joint]))
            self._errors[joint] = _PEAK * size * math.sin(phases[joint])
        self._deviates = any(sizes)


class ArmSensors:
    """Sensors of joints and drives, with noise and quantisation."""

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
        """Return the measured joint angles in the cycle with this number, rad."""
        if rms := self._noise_rad:
            row = self._places.row(number)
            a, b, c, d, e, f = [joint + rms * normal for joint, normal in zip(joints, row, strict=True)]
            joints = a, b, c, d, e, f
        if step := self._step_rad:
            a, b, c, d, e, f = [step * round(joint / step) for joint in joints]
            joints = a, b, c, d, e, f
        return joints

    def read_speeds(self, speeds: Joints, number: int) -> Joints:
        """Return the measured joint speeds, rad/s; 0 for a joint that is stationary, or nearly so."""
        if speeds is ZERO:
            return ZERO
        rms, slow, row = self._noise_rad_s, self._slow, self._speeds.row(number)
        a, b, c, d, e, f = [
            speed + rms * min(abs(speed), slow) / slow * normal
            if abs(speed) >= _LEAST_REPORTED_RAD_S
            else 0.0
            for speed, normal in zip(speeds, row, strict=True)
        ]
        return a, b, c, d, e, f

    def read_currents(self, number: int) -> Joints:
        """Return the currents of a powered arm, A. They consist of noise only."""
        a, b, c, d, e, f = map(mul, self._rms_a, self._currents.row(number))
        return a, b, c, d, e, f

    def read_acceleration(self, number: int) -> Vector:
        """Return the acceleration of the tool, m/s²: gravity with noise."""
        x, y, z = map(mul, self._rms_m_s2, self._accelerations.row(number))
        return x, y, z + _GRAVITY


def own_errors(profile: RtdeProfile) -> Errors:
    """Return the settings for the errors of the arm's own force measurement."""
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
