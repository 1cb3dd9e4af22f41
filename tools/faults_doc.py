"""Tables of docs/reference/faults.md: every emulated fault from the code, with the outcome of a run with this
fault.

The runs use virtual time and take some minutes. `--measure egm ft300` makes only the runs of these devices.
"""

import gc
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from emulators.cell import OWN_FAULTS
from emulators.faults import FOREVER, Fault
from hil_bridge.api import simulate
from hil_bridge.devices.kinds import ROBOTS, SENSORS
from hil_bridge.errors import BridgeError
from hil_bridge.settings.configuration import load_config
from tools.pages import run_jobs, table

ROBOT_NAMES = ("s3", "egm", "rtde", "rsi")
SENSOR_NAMES = ("jr3", "jr3-uart", "jr3-board", "netft", "ati-can", "ft300", "ft300-urcap")
CELL = "every cell"
"""Name for the faults of surface, obstacle, bus and computer, which do not belong to a device."""
PARTNER_SENSOR, PARTNER_ROBOT, BUS_SENSOR = "ft300", "egm", "ati-can"
"""Other device of a run: the sensor for a robot's faults, the robot for a sensor's faults, and the sensor for the
faults of a bus.
"""
MEASURED_ROBOTS, MEASURED_SENSORS = ROBOT_NAMES[1:], SENSOR_NAMES[3:]
SEED = 7
TRACK_S, AFTER_S = 2.0, 0.5
"""Tracking time of a run, and time from the start of tracking to the fault, s."""
GIVEN: Mapping[tuple[str, str], Mapping[str, float]] = {
    ("pose", "offset"): {"z_mm": 20.0},
    ("pose", "encoder-offset"): {"z_mm": 2.0},
    ("pose", "drift"): {"z_mm_s": 5.0},
    ("witness", "offset"): {"z_n": 60.0},
}
"""Parameters of faults that have no effect with their defaults."""
UNMEASURED = ("computer",)
"""Targets whose faults have no runs here. docs/explanation/safety.md has the runs for the computer."""


class Job(NamedTuple):
    """Run with one fault."""

    device: str
    """Name of the kind of device that has the fault, or CELL."""
    on: str
    fault: str

    @property
    def key(self) -> str:
        """Name of the run in the figures."""
        return f"{self.device}: {self.on}: {self.fault}"


def faults_of_device(name: str) -> Mapping[str, Mapping[str, Fault]]:
    """Return the faults that an emulated device can have, by target."""
    if name == CELL:
        return OWN_FAULTS
    kind = ROBOTS.kind(name) if name in ROBOT_NAMES else SENSORS.kind(name)
    assert kind.emulation is not None
    return kind.emulation.faults


def jobs() -> Iterator[Job]:
    """Yield all runs."""
    for device in (*MEASURED_ROBOTS, *MEASURED_SENSORS, CELL):
        for on, faults in faults_of_device(device).items():
            if on not in UNMEASURED:
                yield from (Job(device, on, fault) for fault in faults)


def settings(job: Job) -> Mapping[str, object]:
    """Return the settings of a run that differ from their defaults."""
    robot = job.device if job.device in ROBOT_NAMES else PARTNER_ROBOT
    sensor = job.device if job.device in SENSOR_NAMES else BUS_SENSOR if job.on == "bus" else PARTNER_SENSOR
    given = GIVEN.get((job.on, job.fault), {})
    when = {"phase": "connect"} if job.fault == "wrong-scales" else {"phase": "track", "after_s": AFTER_S}
    own_force = {"cell.egm.measured_force": True} if (robot, job.on) == ("egm", "witness") else {}
    return {
        **own_force,
        "robot.emulated": robot,
        "sensor.emulated": sensor,
        "run.period_ms": 20.0,
        "controller.sample_ms": 20.0,
        "run.duration_s": TRACK_S,
        "run.seed": SEED,
        "faults": [{"on": job.on, "fault": job.fault, "with": given, **when}],
    }


def measured(job: Job) -> Mapping[str, Any]:
    """Return the result of one run: its exit code, and the first line of its cause."""
    try:
        result = simulate(load_config(None, settings(job)))
    except BridgeError as error:
        return {"exit": error.exit_code, "cause": _first_line(str(error))}
    finally:
        gc.collect()  # a cell and its run reference each other
    return {"exit": result.exit_code, "cause": _first_line(result.text)}


def _first_line(text: str) -> str:
    return (text.splitlines() or [""])[0]


def measure(devices: Sequence[str], before: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the results of all runs by name. The runs of these devices are measured again.

    Without names, the runs of all devices are measured again.
    """
    all_jobs = list(jobs())
    again = [job for job in all_jobs if not devices or job.device in devices or job.key not in before]
    results = {job.key: end for job, end in zip(again, run_jobs(measured, again), strict=True)}
    return {job.key: results.get(job.key) or before[job.key] for job in all_jobs}


# --- tables

_MESSAGES = re.compile(
    r"\b(bytes|frames|datagrams|packages|texts|messages|records|samples)\b(?= (?:are|is|come|sent|the))"
)
"""Pattern for the names of each link's units. The table for all links calls them messages."""


def parameters(fault: Fault) -> str:
    """Return the parameters with their defaults, as text."""
    named = ((name, parameter) for name, parameter in fault.parameters.items())
    return ", ".join(f"`{name}` {parameter.default} {parameter.unit}".rstrip() for name, parameter in named)


def lasts(fault: Fault) -> str:
    """Return the default duration as text; empty for a fault that acts once."""
    if fault.lasts_s is None:
        return ""
    return "to the end" if fault.lasts_s == FOREVER else f"{fault.lasts_s:g} s"


def outcomes(names: Sequence[str], on: str, fault: str, figures: Mapping[str, Any]) -> str:
    """Return these devices grouped by the outcome of a run, followed by those without a run."""
    groups: dict[str, list[str]] = {"stops": [], "continues": [], "": []}
    for name in names:
        end = figures.get(Job(name, on, fault).key)
        groups[("stops" if end["exit"] else "continues") if end else ""].append(name)
    return "; ".join(
        f"{', '.join(group)}{verdict and ': ' + verdict}" for verdict, group in groups.items() if group
    )


def target_table(on: str, names: Sequence[str], figures: Mapping[str, Any]) -> str:
    """Return the table of a target's faults. Devices with the same fault share a row."""
    rows = dict[tuple[str, str, str, str], list[str]]()
    for name in names:
        for fault, kind in faults_of_device(name).get(on, {}).items():
            meaning = _MESSAGES.sub("messages", kind.meaning)
            rows.setdefault((fault, meaning, parameters(kind), lasts(kind)), []).append(name)
    ordered = sorted(rows, key=lambda row: [fault for fault, *_ in rows].index(row[0]))
    one = names == (CELL,)
    return table(
        ["fault", "what happens", "parameters", "lasts", "a run" if one else "devices, and what a run did"],
        (
            (
                f"`{row[0]}`",
                *row[1:],
                outcomes(rows[row], on, row[0], figures).removeprefix(f"{CELL}: " if one else ""),
            )
            for row in ordered
        ),
    )


def tables_of(names: Sequence[str], figures: Mapping[str, Any]) -> str:
    """Return a table for each target of these devices."""
    targets = dict.fromkeys(on for name in names for on in faults_of_device(name))
    return "\n\n".join(f"### `{on}`\n\n{target_table(on, names, figures)}" for on in targets)


TABLES: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "robots": partial(tables_of, ROBOT_NAMES),
    "sensors": partial(tables_of, SENSOR_NAMES),
    "cell": partial(tables_of, (CELL,)),
}
JSON_DEPTH = 1
