"""Draw the terminal view into docs/pictures: three sizes of terminal, and a run that a fault has stopped.

The runs use virtual time. The view receives their records as from a real run, so the pictures show the current
code.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from io import StringIO
from typing import Any

from rich.console import Console
from rich.terminal_theme import TerminalTheme

import hil_bridge
from hil_bridge.record import EventKind, Recording
from hil_bridge.record.analysis.summary import TRACK
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import read_config
from hil_bridge.show.terminal.model import Health, Scene, Snapshot, ViewModel
from hil_bridge.show.terminal.panel import panel

PAPER = TerminalTheme(
    (24, 26, 31),
    (222, 226, 232),
    [
        (24, 26, 31), (224, 86, 86), (110, 190, 110), (220, 180, 80),
        (110, 150, 240), (200, 120, 220), (80, 190, 200), (222, 226, 232),
    ],
    [
        (110, 115, 125), (240, 110, 110), (140, 215, 140), (240, 205, 110),
        (140, 175, 250), (220, 150, 240), (110, 215, 225), (255, 255, 255),
    ],
)  # fmt: skip
"""Colours of a terminal. Chosen."""


@dataclass(frozen=True)
class Picture:
    """Picture of a terminal that shows a run."""

    name: str
    width: int
    height: int
    settings: Mapping[str, Any]
    after_s: float
    """Time from the start of tracking to the picture, s."""
    faults: tuple[Mapping[str, Any], ...] = field(default=())


S3 = {"run": {"duration_s": 12.0}}
STREAMED = {"run": {"duration_s": 12.0}, "robot": {"emulated": "rtde"}, "sensor": {"emulated": "netft"}}
RUNS = (
    Picture("terminal-60x20", 60, 20, S3, 6.0),
    Picture("terminal-100x30", 100, 30, S3, 6.0),
    Picture("terminal-200x50", 200, 50, STREAMED, 6.0),
    Picture(
        "terminal-stopped",
        100,
        30,
        S3,
        3.0,
        ({"on": "signal", "fault": "offset", "phase": "track", "after_s": 2.0, "with": {"amount": 45.0}},),
    ),
)


def snapshot_of(picture: Picture) -> Snapshot:
    """Return the view's state at the given time of a run."""
    result = hil_bridge.simulate(picture.settings, faults=picture.faults)
    record: Recording = result.recording
    config = read_config(picture.settings)
    begin = next(cycle.started_at for cycle in record.cycles if cycle.phase == TRACK)
    until = begin + picture.after_s
    facts = devices_of(record).robot
    scene = Scene(
        reference_n=config.task.force_n,
        robot=facts,
        total_s=config.run.duration_s,
        cell=Setup(config).cell_name.words,
        devices=Setup(config).cell_name.devices,
        limits=config.limits,
        places=RunPlaces("runs/2026-11-23T10-12-31/run.mcap"),
        keys=True,
    )
    model = ViewModel(scene)
    model.snapshot(record.events[0].at, Health())
    for event in record.events:
        if event.at <= until:
            (model.check(event.text) if event.kind == EventKind.CHECK else model.event(event))
    frames = [frame for frame in record.sensors if frame.at <= until]
    for cycle in record.cycles:
        if cycle.answered_at <= until:
            model.update(cycle)
    return model.snapshot(until, Health(sensor_at=frames[-1].at if frames else None))


def draw(picture: Picture) -> str:
    """Return the picture as SVG. The same code always draws the same picture."""
    width, height = picture.width, picture.height
    console = Console(record=True, width=width, height=height, color_system="truecolor", file=StringIO())
    console.print(panel(snapshot_of(picture), width, height))
    return console.export_svg(title="hil-bridge run", theme=PAPER, unique_id=picture.name)


PICTURES = {f"{run.name}.svg": partial(draw, run) for run in RUNS}
