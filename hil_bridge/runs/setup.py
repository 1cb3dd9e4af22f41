"""Resolution of a configuration to devices, facts, pace and loop, in a single module and only once."""

from functools import cached_property
from typing import Any, NamedTuple

import msgspec

from emulators.cell import Cell
from hil_bridge.control import ControlLoop
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.kinds import SURFACES, EmulatedKinds, SurfaceKind
from hil_bridge.runs.pace import control_loop, describe_pace, set_pace
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.devices import (
    CellName,
    Robot,
    Sensor,
    name_cell,
    robot_at,
    robot_in,
    sensor_at,
    sensor_in,
)
from hil_bridge.settings.kinds import surface_settings
from hil_bridge.transports.urls import naming_kind

_OF_THE_LINK = ("hops", "routine", "errors", "traffic")
"""Facts that an open link adds for display. No decision depends on them."""


class Listen(NamedTuple):
    """URLs at which the devices of an emulated cell listen. "" selects the default of the kind, and None stands for
    a device that is not served.
    """

    robot: str | None = ""
    sensor: str | None = ""
    panel: str = ""
    """URL of the emulated controller's panel, for operators; empty if there is no panel."""


class Setup:
    """Everything that follows from a configuration before a connection is opened.

    Each part is resolved on first use, and raises ConfigError if it is invalid, so that a check can report each
    fault separately.
    """

    def __init__(self, config: Config, listen: Listen | None = None) -> None:
        """Create a setup. `listen` gives the URLs of the emulated devices. If it is None, each device without a URL
        listens at its default.
        """
        self._requested = config
        self.cell: Cell[Any, Any] | None = None
        """Emulated cell, once the checks have powered it up; None before, and if both devices are real."""
        self.listen = listen or Listen(
            None if config.robot.url else "", None if config.sensor.url else "", config.run.panel_url
        )

    @cached_property
    def robot(self) -> Robot:
        """Robot of the run."""
        return robot_in(self._requested)

    @cached_property
    def sensor(self) -> Sensor:
        """Force sensor of the run."""
        return sensor_in(self._requested)

    @cached_property
    def cell_robot(self) -> Robot:
        """Robot of the emulated cell, with the URL at which it listens; "" for the default of its kind."""
        return robot_at(self._requested, self.listen.robot or "")

    @cached_property
    def cell_sensor(self) -> Sensor:
        """Sensor of the emulated cell, with the URL at which it listens; "" for the default of its kind."""
        return sensor_at(self._requested, self.listen.sensor or "")

    @cached_property
    def cell_surface(self) -> tuple[SurfaceKind, Any] | None:
        """Surface of the emulated cell with its settings, if a plug-in provides it."""
        name = self._requested.cell.surface_kind
        if not name:
            return None
        kind = SURFACES.kind(name)
        return kind, surface_settings(self._requested, kind)

    @property
    def emulated(self) -> EmulatedKinds:
        """Kinds of devices in the emulated cell."""
        surface = self.cell_surface
        return EmulatedKinds(self.cell_robot.kind, self.cell_sensor.kind, surface and surface[0])

    @cached_property
    def facts(self) -> RobotFacts:
        """Facts of the robot before it is connected."""
        with naming_kind(self.robot.kind.name):
            return self.identified(self.robot.kind.facts(self.robot.url, self.robot.settings))

    def identified(self, facts: RobotFacts) -> RobotFacts:
        """Return the facts that a robot reports, together with the name of its kind and whether it is emulated."""
        robot = self.robot
        return msgspec.structs.replace(facts, kind=robot.kind.name, emulated=robot.is_emulated)

    @cached_property
    def config(self) -> Config:
        """Configuration of the run with period, sample time and tuning filled in."""
        frame_s = self.sensor.kind.period(self.sensor.settings) or 0.0
        return set_pace(self._requested, self.facts, frame_s)

    @property
    def remark(self) -> str:
        """One-line remark on the pace of the controller, or an empty string."""
        return describe_pace(self._requested, self.config, self.facts.cycle_s)

    @cached_property
    def loop(self) -> ControlLoop:
        """Control loop."""
        return control_loop(self.config, self.facts)

    def loop_for(self, facts: RobotFacts) -> ControlLoop:
        """Return the control loop for a connected robot with the given facts."""
        facts = self.identified(facts)
        added = {name: getattr(facts, name) for name in _OF_THE_LINK}
        known = msgspec.structs.replace(self.facts, **added)
        return self.loop if facts == known else control_loop(self.config, facts)

    @property
    def cell_name(self) -> CellName:
        """Name of the cell, for display."""
        return name_cell(self.robot, self.sensor)
