"""Resolution of a configuration, in one place and once: devices, facts, pace, loop."""

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

_OF_THE_LINK = ("hops", "routine", "errors", "traffic")
"""Facts that an open link adds for display. No decision depends on them."""


class Listen(NamedTuple):
    """URLs at which the devices of an emulated cell listen: "" for the usual one of the kind, None for a device that is
    not served.
    """

    robot: str | None = ""
    sensor: str | None = ""
    panel: str = ""
    """URL of the emulated controller's panel, for operators; empty without one."""


class Setup:
    """Everything that follows from a configuration before a wire is opened.

    Each part is resolved when it is first used, and raises ConfigError then: a check can name each fault by itself.
    """

    def __init__(self, config: Config, listen: Listen | None = None) -> None:
        """`listen` gives the URLs of the emulated devices; None: each without a URL listens at its default."""
        self._given = config
        self.cell: Cell[Any, Any] | None = None
        """The emulated cell, once the checks have powered it up; None before, and if both devices are real."""
        self.listen = listen or Listen(
            None if config.robot.url else "", None if config.sensor.url else "", config.run.panel_url
        )

    @cached_property
    def robot(self) -> Robot:
        """The robot of the run."""
        return robot_in(self._given)

    @cached_property
    def sensor(self) -> Sensor:
        """The force sensor of the run."""
        return sensor_in(self._given)

    @cached_property
    def cell_robot(self) -> Robot:
        """The robot of the emulated cell, with the URL at which it listens; "" for the default of its kind."""
        return robot_at(self._given, self.listen.robot or "")

    @cached_property
    def cell_sensor(self) -> Sensor:
        """The sensor of the emulated cell, with its URL as for `cell_robot`."""
        return sensor_at(self._given, self.listen.sensor or "")

    @cached_property
    def cell_surface(self) -> tuple[SurfaceKind, Any] | None:
        """The surface of the emulated cell with its settings, if a plug-in provides it."""
        name = self._given.cell.surface_kind
        if not name:
            return None
        kind = SURFACES.kind(name)
        return kind, surface_settings(self._given, kind)

    @property
    def emulated(self) -> EmulatedKinds:
        """The kinds of devices in the emulated cell."""
        surface = self.cell_surface
        return EmulatedKinds(self.cell_robot.kind, self.cell_sensor.kind, surface and surface[0])

    @cached_property
    def facts(self) -> RobotFacts:
        """Facts of the robot before it is connected."""
        return self.identified(self.robot.kind.facts(self.robot.url, self.robot.settings))

    def identified(self, facts: RobotFacts) -> RobotFacts:
        """Return the facts that a robot reports, with the name of its kind and whether it is emulated."""
        robot = self.robot
        return msgspec.structs.replace(facts, kind=robot.kind.name, emulated=robot.is_emulated)

    @cached_property
    def config(self) -> Config:
        """The configuration as run: period, sample time and tuning written out."""
        frame_s = self.sensor.kind.period(self.sensor.settings) or 0.0
        return set_pace(self._given, self.facts, frame_s)

    @property
    def remark(self) -> str:
        """One-line remark on the pace of the controller; empty for none."""
        return describe_pace(self._given, self.config, self.facts.cycle_s)

    @cached_property
    def loop(self) -> ControlLoop:
        """The control loop."""
        return control_loop(self.config, self.facts)

    def loop_for(self, facts: RobotFacts) -> ControlLoop:
        """Return the control loop for a connected robot with these facts."""
        facts = self.identified(facts)
        added = {name: getattr(facts, name) for name in _OF_THE_LINK}
        known = msgspec.structs.replace(self.facts, **added)
        return self.loop if facts == known else control_loop(self.config, facts)

    @property
    def cell_name(self) -> CellName:
        """Name of the cell, for display."""
        return name_cell(self.robot, self.sensor)
