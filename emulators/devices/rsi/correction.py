"""POSCORR and AXISCORR with their monitors: total corrections, their limits, and the drives' refusal of jumps.

Source: project specification of RSI, section 5.
"""

import math

from emulators.devices.rsi.profile import RsiProfile
from protocol.devices.rsi.arm import Model
from protocol.geometry import Pose, angles_of, from_angles, product, rotate
from protocol.kinematics import Joints

TOO_FAR = "KSS29000: POSCORR: permissible overall correction exceeded: RSI is stopped"
AXES_TOO_FAR = "KSS29000: AXISCORR: permissible overall correction exceeded: RSI is stopped"
"""Error text. Derived from the text of POSCORR."""
TOO_FAST = "Stop by $CORRECTION function"
_REFERENCE_MS = 4.0
"""Cycle time to which the maximum step refers, ms."""
_ROUNDING = 1e-9

Total = tuple[float, ...]
"""Total correction: X Y Z in mm, A B C in degrees."""
NOTHING: Total = (0.0,) * 6


class Correction:
    """Correction of the tool's pose in one session."""

    def __init__(self, profile: RsiProfile, programmed: Pose) -> None:
        """Start without a correction. `programmed` is the uncorrected pose, with a unit quaternion."""
        self._profile = profile
        self.programmed = programmed
        self.total = NOTHING
        self._margin_mm, self._margin_at = math.inf, NOTHING
        steps = profile.cycle_ms / _REFERENCE_MS
        self.step_mm, self._step_deg = profile.max_step_mm * steps, profile.max_step_deg * steps
        """Maximum change of the correction per cycle: position, mm, and rotation, degrees."""
        self.step_rad = math.radians(self._step_deg)

    def take(self, value: tuple[float, ...]) -> str:
        """Apply the correction of a cycle. Return an error, which leaves the total unchanged, or an empty string."""
        before = self.total
        after = self._clamp(self._add_up(value) if self._profile.mode == "relative" else value)
        error = self._check_monitor(after)
        x, y, z, *turn = [there - here for there, here in zip(after, before, strict=True)]
        if not error and (
            math.hypot(x, y, z) > self.step_mm + _ROUNDING or _angle(turn) > self._step_deg + _ROUNDING
        ):
            error = TOO_FAST
        if not error:
            self.total = after
        return error

    def narrow(self, margin_mm: float | None) -> None:
        """Limit how far the correction may grow beyond its current value, as a fault does. None removes the limit."""
        if margin_mm is None:
            self._margin_mm = math.inf
        elif self._margin_mm == math.inf:
            self._margin_mm, self._margin_at = margin_mm, self.total

    @property
    def pose(self) -> Pose:
        """Corrected pose."""
        return self.applied_to(self.programmed)

    def applied_to(self, pose: Pose) -> Pose:
        """Return the given pose after the correction."""
        return self.corrected(pose, self.total)

    def corrected(self, pose: Pose, total: Total) -> Pose:
        """Return a pose after this total correction."""
        (x, y, z), start = pose
        dx, dy, dz, *angles = total
        a, b, c = angles
        turn = from_angles(a, b, c)
        offset = dx / 1e3, dy / 1e3, dz / 1e3
        if self._profile.ref == "base":
            return Pose((x + offset[0], y + offset[1], z + offset[2]), product(turn, start))
        now = product(start, turn)
        wx, wy, wz = rotate(start if self._profile.tool_frame == "start" else now, offset)
        return Pose((x + wx, y + wy, z + wz), now)

    def _add_up(self, value: tuple[float, ...]) -> Total:
        total = [here + more for here, more in zip(self.total, value, strict=True)]
        if self._profile.rel_rot == "compose":
            (a, b, c), (da, db, dc) = self.total[3:], value[3:]
            total[3:] = angles_of(product(from_angles(da, db, dc), from_angles(a, b, c)))
        return tuple(total)

    def _clamp(self, requested: Total) -> Total:
        most = self._profile.lim_mm
        kept = []
        for value, at in zip(requested[:3], self._margin_at[:3], strict=True):
            low, high = max(-most, at - self._margin_mm), min(most, at + self._margin_mm)
            kept.append(max(low, min(high, value)))
        angle = _angle(requested[3:])
        share = min(1.0, self._profile.lim_deg / angle) if angle else 1.0
        return (*kept, *[share * part for part in requested[3:]])

    def _check_monitor(self, total: Total) -> str:
        offset = total[:3]
        far = math.hypot(*offset) if self._profile.mon_norm == "euclid" else max(map(abs, offset))
        return TOO_FAR if far > self._profile.mon_mm or _angle(total[3:]) > self._profile.mon_deg else ""


class AxisCorrection:
    """Correction of the axes in one session, degrees."""

    def __init__(self, profile: RsiProfile, programmed: Joints, model: Model) -> None:
        """Start without a correction. `programmed` are the uncorrected axes."""
        self._profile, self.programmed = profile, programmed
        self._lowest: Total = tuple([-limit for limit in profile.lim_axis_deg])
        self._highest: Total = profile.lim_axis_deg
        if profile.axis_ends == "cut":
            ends = model.lowest_deg, model.highest_deg
            lowest, highest = (
                [end - axis for end, axis in zip(row, programmed, strict=True)] for row in ends
            )
            self._lowest = tuple(map(max, self._lowest, lowest))
            self._highest = tuple(map(min, self._highest, highest))
        self.total = NOTHING
        self.steps = tuple(speed * profile.period for speed in model.axis_speeds_deg_s)
        """Maximum change of each axis per cycle, degrees."""
        self._margin_deg, self._margin_at = math.inf, NOTHING

    def narrow(self, margin_deg: float | None) -> None:
        """Limit how far an axis may turn beyond its current value, as a fault does. None removes the limit."""
        if margin_deg is None:
            self._margin_deg = math.inf
        elif self._margin_deg == math.inf:
            self._margin_deg, self._margin_at = margin_deg, self.total

    def take(self, value: tuple[float, ...]) -> str:
        """Apply the correction of a cycle. Return an error, which leaves the total unchanged, or an empty string."""
        profile, before = self._profile, self.total
        if value == before == NOTHING:  # the usual case: only the pose is corrected
            return ""
        if profile.mode == "relative":
            value = tuple([here + more for here, more in zip(before, value, strict=True)])
        limits = zip(self._lowest, value, self._highest, strict=True)
        after = tuple([max(low, min(high, part)) for low, part, high in limits])
        if self._margin_deg < math.inf:
            margin = self._margin_deg
            kept = zip(after, self._margin_at, strict=True)
            after = tuple([max(at - margin, min(at + margin, part)) for part, at in kept])
        if any(abs(part) > limit for part, limit in zip(after, profile.mon_axis_deg, strict=True)):
            return AXES_TOO_FAR
        changes = zip(after, before, self.steps, strict=True)
        if any(abs(to - was) > step + _ROUNDING for to, was, step in changes):
            return TOO_FAST
        self.total = after
        return ""

    @property
    def joints(self) -> Joints:
        """Corrected axes, degrees."""
        a, b, c, d, e, f = (start + by for start, by in zip(self.programmed, self.total, strict=True))
        return a, b, c, d, e, f


def _angle(angles: tuple[float, ...] | list[float]) -> float:
    """Return the angle of the rotation by A, B, C, degrees."""
    a, b, c = angles
    if a == b == c == 0.0:  # the case if the tool keeps its orientation
        return 0.0
    w, x, y, z = from_angles(a, b, c)
    return math.degrees(2.0 * math.atan2(math.hypot(x, y, z), abs(w)))
