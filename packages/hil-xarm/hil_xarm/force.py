"""Emulated six-axis force sensor at the flange of the arm, which the control box reads and reports.

The raw values have a zero of their own. The external values are relative to the zero that was set last, and exclude the
weight of the load that is set in the box. While the sensor is off, all values are zero.
"""

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from emulators.faults.ledger import Handler
from emulators.faults.own import OwnFaults
from emulators.faults.packets import SENSOR_WIRE
from emulators.seams import WrenchSource
from emulators.sensing import Converter, MeasuredWrench
from emulators.sensing.settings import per_axis, unrest
from hil_xarm.cable import Cable, Server
from hil_xarm.codes import Error
from hil_xarm.connections import ReportConnection
from hil_xarm.profile import XarmProfile
from hil_xarm.reports import Port
from protocol.geometry import Quaternion, Wrench, inverse, rotate

NOTHING: Wrench = (0.0,) * 6
_GRAVITY = 9.80665
_KEPT = 64
"""Number of reports whose sample times are kept. Chosen: more than a client has not read yet."""


class ForceSensor:
    """Sensor. An `EmulatedSensor`; `equip` of the robot connects it to a control box."""

    def __init__(self, profile: XarmProfile, source: WrenchSource, powered_at: float, seed: int) -> None:
        self.profile, self.powered_at, self.seed = profile, powered_at, seed
        steps = np.array((*(profile.resolution_n,) * 3, *(profile.resolution_nm,) * 3))
        ranges = np.array(profile.ranges)
        zero = np.array((*profile.zero_n, 0.0, 0.0, 0.0)) / steps
        ends = ranges * profile.overload_share / steps
        noise = np.array((*per_axis(profile.noise_n), *per_axis(profile.noise_nm))) / steps
        converter = Converter(
            np.diag(1.0 / steps), noise, -ends, ends, unrest=unrest(profile, powered_at), full_scale=ranges
        )
        self._steps, self._zero_counts = steps, zero
        self._measured = MeasuredWrench(source, profile.rate_hz, converter, seed, "cell.xarm.noise_n")
        self.is_on = profile.sensor_on
        self.robot: Any = None
        """Emulated robot whose box reads the sensor; None until it is equipped."""
        self._zero: Wrench = NOTHING
        """Raw wrench at which the external one is zero, without the weight of the load."""
        self._zero_at: float | None = None
        """Time at which a zero takes effect, s."""
        self._sent: deque[tuple[int, float]] = deque(maxlen=_KEPT)
        self.cable = Cable(f"{seed} sensor")
        self.faults = OwnFaults()
        self.handlers: Mapping[str, Mapping[str, Handler]] = {
            "signal": self._measured.signal.handlers,
            SENSOR_WIRE: self.cable.handlers,
            "sensor": {
                **self.faults.held(("lost", "saturated", "unreadable")),
                **self.faults.striking({"switched-off": self._switch_off, "zeroed": self.set_zero}),
            },
        }

    @property
    def endpoint(self) -> Server:
        """Another connection to the real reports of the box that reads the sensor."""
        inner = ReportConnection(self.robot.box, Port.REAL, self.powered_at, self.report)
        return self.cable.open(inner, Port.REAL, self.powered_at)

    @property
    def zero(self) -> Wrench:
        """Zero that was set last, N and N·m."""
        return self._zero

    # --- for the box

    def enable(self, is_on: bool) -> None:
        """Switch the sensor on or off."""
        self.is_on = is_on

    def _switch_off(self, now: float) -> None:
        self.is_on = False

    def set_zero(self, now: float) -> None:
        """Begin to set the zero: after a time, the present wrench is the zero of the external values."""
        self._zero_at = now + self.profile.zero_ms / 1e3

    def find_error(self, now: float) -> int:
        """Return the error that the sensor causes; 0 for none."""
        if self.faults.holds("lost", now):
            return Error.SENSOR_LOST
        if self.faults.holds("unreadable", now):
            return Error.SENSOR_READ
        newest = self._measured.number_at(now)
        if self.is_on and self._measured.last_at_end(newest, newest) is not None:
            return Error.SENSOR_OVERLOAD
        return Error.NONE

    def read(self, now: float, flange: Quaternion) -> tuple[Wrench, Wrench]:
        """Return the raw and the external wrench, N and N·m, sensor frame. `flange` is the orientation of the flange in
        the base frame.
        """
        self.faults.under_way("lost", now)
        if not self.is_on or self.faults.holds("lost", now):
            return NOTHING, NOTHING
        if self._zero_at is not None and self._zero_at <= now:
            self._zero, self._zero_at = self._unloaded(self._raw(self._zero_at), flange), None
        raw = self._raw(now)
        a, b, c, d, e, f = (
            value - zero for value, zero in zip(self._unloaded(raw, flange), self._zero, strict=True)
        )
        return raw, (a, b, c, d, e, f)

    def report(self, number: int, now: float) -> None:
        """Note that a report with a number contains the sample of now."""
        self._sent.append((number, self._measured.number_at(now) / self.profile.rate_hz))

    def sampled_at(self, counter: int) -> float | None:
        """Return the time of the sample in the report with this number, counted by its client from 1."""
        return next((at for number, at in reversed(self._sent) if number == counter), None)

    def _raw(self, now: float) -> Wrench:
        number = self._measured.number_at(now)
        counts = self._measured.outputs(number, number)[0] + self._zero_counts
        if self.faults.any and self.faults.under_way("saturated", now):
            counts = np.array(self.profile.ranges) / self._steps
        a, b, c, d, e, f = (np.rint(counts) * self._steps).tolist()
        return a, b, c, d, e, f

    def _unloaded(self, raw: Wrench, flange: Quaternion) -> Wrench:
        """Return a wrench without the weight of the load that is set in the box."""
        mass, *centre = self.robot.box.load
        if not mass:
            return raw
        x, y, z = rotate(inverse(flange), (0.0, 0.0, -mass * _GRAVITY))
        u, v, w = (part / 1e3 for part in centre)
        fx, fy, fz, mx, my, mz = raw
        moment = v * z - w * y, w * x - u * z, u * y - v * x
        return fx - x, fy - y, fz - z, mx - moment[0], my - moment[1], mz - moment[2]
