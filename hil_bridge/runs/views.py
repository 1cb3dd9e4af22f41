"""Live views of a run on the terminal and on a page in the browser."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from hil_bridge.console import keys
from hil_bridge.control.program.leg import Leg
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.errors import ConfigError
from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.runs.running import Running
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config
from hil_bridge.show.terminal import Health, Scene
from hil_bridge.show.web.feed import Feed, WebOptions
from protocol.geometry import Vector

_FARTHEST_MM = 300.0
"""Length of the path up to which the work piece of a long run is drawn, mm. Chosen."""


@dataclass(frozen=True, slots=True)
class Views:
    """Requested views of a run."""

    terminal: bool = True
    web: WebOptions | None = None
    """Options of the page; None if no page is requested."""


@contextmanager
def open_feed(views: Views, virtual: bool) -> Iterator[Feed | None]:
    """Open the feed of the page, if the page is requested. Raises ConfigError."""
    if views.web is None:
        yield None
        return
    if virtual:
        raise ConfigError(
            "--web shows a run that continues in real time; run without it, then `hil-bridge view` its recording"
        )
    feed = Feed(views.web)
    try:
        yield feed
    finally:
        feed.close()


def scene_of(setup: Setup, facts: RobotFacts, legs: Sequence[Leg], places: RunPlaces) -> Scene:
    """Return the facts of a run that its views show."""
    config = setup.config
    cell = setup.cell_name
    return Scene(
        reference_n=config.task.force_n,
        robot=facts,
        total_s=None if legs else config.run.duration_s,
        steps=tuple(leg.label for leg in legs),
        tracks=frozenset(
            number for number, leg in enumerate(legs, 1) if leg.step.controls and leg.way is not None
        ),
        cell=cell.words,
        devices=cell.devices,
        real=cell.real,
        limits=config.limits,
        approach=config.frame.approach,
        places=places,
        keys=keys.is_interactive(),
    )


def planned_places(config: Config, legs: Sequence[Leg]) -> list[Vector]:
    """Return places on the paths that a run plans, base frame, m. Positions that the run will determine are guesses."""
    frame, x, y = config.frame, 0.0, 0.0
    plan = [(x, y)]
    for leg in legs:
        if leg.step.goal_mm is not None:
            x, y = leg.step.goal_mm
            plan.append((x, y))
        elif (path := leg.way) is not None:
            plan += [(x + u * 1e3, y + v * 1e3) for u, v in path.points]
            x, y = plan[-1]
    if not legs:
        plan.append((min(config.task.speed_mm_s * config.run.duration_s, _FARTHEST_MM), 0.0))
    origin = frame.origin_mm or config.cell.start_position_mm
    places = np.array(origin) + np.array(plan) @ np.array([frame.travel, frame.across])
    return [(u, v, w) for u, v, w in (1e-3 * places).tolist()]


def health_of(run: Running | None) -> Health:
    """Return the state of a run's links. `run` is None while the devices are not open."""
    if run is None:
        return Health()
    counters, newest, peaks = run.robot.counters, run.sensor.newest, run.sensor.peaks
    return Health(
        link_errors=sum(counters.get(name, 0) for name in run.facts.errors),
        frames_lost=run.sensor.lost,
        sensor_at=None if newest is None else newest.at,
        link=dict(counters),
        force=None if newest is None or peaks is None else peaks.along(newest.values),
    )
