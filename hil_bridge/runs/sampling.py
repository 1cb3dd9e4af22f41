"""Sample of a cycle, from the robot's report and the newest frame of the sensor."""

import math

from hil_bridge.clock import Clock
from hil_bridge.control import Peaks, Sample, WristAtOrientation
from hil_bridge.devices.robots.seam import RobotReport, fault_reason, orientation_fault
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import BridgeError, Cause
from hil_bridge.runs.axis_evidence import dead_axis_text
from hil_bridge.runs.journal import Journal
from hil_bridge.runs.reaction_times import usual_gap
from hil_bridge.runs.zeroing import Zero, Zeroing, known_wrist, wrist
from hil_bridge.settings.configuration import Config
from protocol.geometry import Quaternion, angle_between
from protocol.wrench import WrenchFrame

TURNED_RAD = math.radians(0.05)
"""Rotation of the tool below which its wrist counts as unchanged, rad. Chosen: it changes a force of 10 N by 0.01 N."""
_APPROACH, _TRAVEL, _ACROSS = 0, 1, 2
"""Directions in which the contact force is measured, as indices into `WristAtOrientation.directions`."""


class Sampler:
    """Source of the samples of one run."""

    def __init__(
        self, config: Config, clock: Clock, zeroing: Zeroing, sensor: ForceSensor, journal: Journal
    ) -> None:
        frame = config.frame
        self._config, self._clock, self._sensor, self._zeroing = config, clock, sensor, zeroing
        self._journal = journal
        self._directions = frame.approach, frame.travel, frame.across
        self._turns = False
        """Whether a program turns the tool."""
        self._wrist = wrist(config)
        self._tare: Quaternion | None = None
        """Orientation at which the sensor was zeroed; None if the sensor's own zero is not used."""
        self._at_orientation: tuple[Quaternion, WristAtOrientation] | None = None
        self._filter_delay = math.nan
        self._due_after = math.inf
        """Age of the newest frame above which the next frame is late, s."""
        self._start: Quaternion
        self.peaks: Peaks | None = None
        """Peaks since the last order that the robot accepted; None before the first cycle."""

    def expect_turns(self) -> None:
        """Prepare for a program that turns the tool. The weight of a known tool is then computed for each
        orientation.
        """
        self._turns = True
        self._wrist = known_wrist(self._config) or self._wrist

    def sensor_is_ready(self) -> None:
        """Store the delay and the frame period of a sensor that has become ready."""
        self._filter_delay = self._sensor.delay
        self._due_after = usual_gap(self._sensor.facts)

    def begin(self, zero: Zero, tare: Quaternion) -> None:
        """Begin with the given zero. `tare` is the orientation at which the sensor was zeroed."""
        self._start = zero.start.pose.quaternion
        self._tare = tare if self._config.sensor.tare else None
        at_start = self.wrist_at(self._start)
        self._sensor.peaks = self.peaks = Peaks(at_start, self._sensor.facts.scales, zero.contact)

    def take(self, report: RobotReport, frame: WrenchFrame, ordered: Quaternion, held: bool) -> Sample:
        """Return the sample of the newest data, after the robot has reported its pose. `ordered` is the orientation
        in the last order. `held` is True while an operator holds the tool.
        """
        sensor, (position, quaternion), fault = self._sensor, report.pose, fault_reason(report)
        try:
            sensor.check()
        except BridgeError as error:
            self._journal.trace(error)
            fault = fault or error.reason(Cause.SENSOR_FAILED)
        assert sensor.peaks is not None
        peak_force, peak_resultant, peak_moment, saturated = sensor.peaks.take()
        if orientation_fault(quaternion):
            quaternion = self._start  # reported by the fault
        now = self._clock.now()
        wrist = self.wrist_at(quaternion)
        wrench = wrist.contact_wrench(sensor.wrench(frame))
        force = wrist.force_along(_APPROACH, wrench)
        paired = sensor.wrench_at(report.pose_at + self._filter_delay + sensor.late)
        return Sample(
            now,
            position,
            force,
            resultant=math.hypot(wrench[0], wrench[1], wrench[2]),
            sensor_at=sensor.newest_at,
            sensor_sequence=frame.sequence,
            repeated_frames=sensor.repeated,
            saturated=saturated or bool(sensor.saturated),
            dead_axis=dead_axis_text(self._wrist, self._config.frame.approach, quaternion, sensor.dead),
            fault=fault,
            force_travel=wrist.force_along(_TRAVEL, wrench),
            wrench=wrench,
            position_at=report.pose_at,
            paired_force=None
            if paired is None
            else wrist.force_along(_APPROACH, wrist.contact_force(paired)),
            peak_force=peak_force,
            peak_resultant=peak_resultant,
            peak_moment=peak_moment,
            tilt=0.0 if quaternion == ordered else angle_between(ordered, quaternion),
            unchanged=frame.at - sensor.unchanged_since,
            quaternion=quaternion,
            held=held,
            witness=self._zeroing.own_force.along(report),
            doubt=int(self._zeroing.doubt(force)),
            overdue=max(now - frame.at - self._due_after, 0.0),
            force_across=wrist.force_along(_ACROSS, wrench),
            hidden=self._zeroing.axes.hidden(wrist, wrench, force),
        )

    def hidden_at_rest(self, orientation: Quaternion) -> float:
        """Return the force across the approach that the moments of the newest frame show and its forces do not, N."""
        newest = self._sensor.newest
        assert newest is not None
        at, tolerance = self.wrist_at(orientation), self._config.limits.weight_tolerance_n
        return self._zeroing.axes.hidden_at_rest(at, self._sensor.wrench(newest), tolerance)

    def wrist_at(self, quaternion: Quaternion) -> WristAtOrientation:
        """Return the wrist at the given orientation. It is recomputed only if the tool has turned."""
        if self._at_orientation is None or self._has_turned(self._at_orientation[0], quaternion):
            at = self._wrist.at_orientation(quaternion, self._tare, *self._directions)
            self._at_orientation = quaternion, at
            if self._turns and self.peaks is not None:
                self.peaks.turn(at, self._sensor.facts.scales)
        return self._at_orientation[1]

    def _has_turned(self, known: Quaternion, quaternion: Quaternion) -> bool:
        """Return whether the wrist must be recomputed. While a program turns the tool, tiny changes are ignored."""
        near = self._turns and angle_between(known, quaternion) <= TURNED_RAD
        return known != quaternion and not near
