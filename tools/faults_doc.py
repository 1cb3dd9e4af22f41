"""Tables of docs/reference/faults.md: every emulated fault from the code, what a run did from runs.

The runs are made in virtual time; they take some minutes. `--measure egm ft300` makes those of these devices alone.
"""

import gc
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
"""Stands for the faults that no device has: of surface, obstacle, bus and computer."""
PARTNER_SENSOR, PARTNER_ROBOT, BUS_SENSOR = "ft300", "egm", "ati-can"
"""The other device of a run: of a robot's faults, of a sensor's faults, and the sensor of the faults of a bus."""
MEASURED_ROBOTS, MEASURED_SENSORS = ROBOT_NAMES[1:], SENSOR_NAMES[3:]
SEED = 7
TRACK_S, AFTER_S = 2.0, 0.5
"""Time for which a run tracks, and when the fault comes after the begin of that, s."""
GIVEN: Mapping[tuple[str, str], Mapping[str, float]] = {
    ("pose", "offset"): {"z_mm": 20.0},
    ("pose", "encoder-offset"): {"z_mm": 2.0},
    ("pose", "drift"): {"z_mm_s": 5.0},
    ("witness", "offset"): {"z_n": 60.0},
}
"""Parameters of the runs, where a fault with its defaults is none."""
UNMEASURED = ("computer",)
"""Targets of which no run is made here: docs/explanation/safety.md has that of the computer."""


class Job(NamedTuple):
    """One run with one fault."""

    device: str
    """Name of the kind that has the fault, or CELL."""
    on: str
    fault: str

    @property
    def key(self) -> str:
        """Its name in the figures."""
        return f"{self.device}: {self.on}: {self.fault}"


def faults_of_device(name: str) -> Mapping[str, Mapping[str, Fault]]:
    """The faults of an emulated device by target, those alone that it can have."""
    if name == CELL:
        return OWN_FAULTS
    kind = ROBOTS.kind(name) if name in ROBOT_NAMES else SENSORS.kind(name)
    assert kind.emulation is not None
    return kind.emulation.faults


def jobs() -> Iterator[Job]:
    """All runs."""
    for device in (*MEASURED_ROBOTS, *MEASURED_SENSORS, CELL):
        for on, faults in faults_of_device(device).items():
            if on not in UNMEASURED:
                yield from (Job(device, on, fault) for fault in faults)


def settings(job: Job) -> Mapping[str, object]:
    """The settings of a run; all others stand at their defaults."""
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
    """The end of one run: its exit code, and the first line of its cause."""
    try:
        result = simulate(load_config(None, settings(job)))
    except BridgeError as error:
        return {"exit": error.exit_code, "cause": _first_line(str(error))}
    finally:
        gc.collect()  # a cell and its run refer to each other
    return {"exit": result.exit_code, "cause": _first_line(result.text)}


def _first_line(text: str) -> str:
    return (text.splitlines() or [""])[0]


def measure(devices: Sequence[str], before: Mapping[str, Any]) -> Mapping[str, Any]:
    """The ends of all runs by the name of each, those of these devices measured anew; of all where none is named."""
    wanted = list(jobs())
    anew = [job for job in wanted if not devices or job.device in devices or job.key not in before]
    found = {job.key: end for job, end in zip(anew, run_jobs(measured, anew), strict=True)}
    return {job.key: found.get(job.key) or before[job.key] for job in wanted}


# --- tables


def parameters(fault: Fault) -> str:
    """Parameters with defaults and ranges, and the duration."""
    parts = []
    for name, parameter in fault.all_parameters.items():
        default = "to the end" if parameter.default == FOREVER else f"{parameter.default}"
        parts.append(f"`{name}` = {default} ({parameter.range_text})")
    return "<br>".join(parts)


def device_table(name: str, figures: Mapping[str, Any]) -> str:
    """Every fault of a device; with the end of a run where such runs are made."""
    found = faults_of_device(name)
    told = name not in (*ROBOT_NAMES, *SENSOR_NAMES) or name in (*MEASURED_ROBOTS, *MEASURED_SENSORS)
    rows = []
    for on, faults in found.items():
        for fault, words in faults.items():
            end = figures.get(Job(name, on, fault).key)
            run = ([str(end["exit"]), end["cause"] or "goes on"] if end else ["", ""]) if told else []
            rows.append([f"`{on}`", f"`{fault}`", words.meaning, parameters(words), *run])
    head = ["on", "fault", "what happens", "parameters", *(["exit code", "a run ends with"] if told else [])]
    return table(head, rows)


def have_table(names: Sequence[str]) -> str:
    """Which of these devices have which faults."""
    found = {name: faults_of_device(name) for name in names}
    pairs = dict.fromkeys((on, fault) for faults in found.values() for on in faults for fault in faults[on])
    order = list(dict.fromkeys(on for on, _ in pairs))
    rows = (
        (f"`{on}`", f"`{fault}`", *("yes" if fault in found[name].get(on, {}) else "–" for name in names))
        for on, fault in sorted(pairs, key=lambda pair: order.index(pair[0]))
    )
    return table(["on", "fault", *names], rows)


TABLES: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "robots": lambda figures: have_table(ROBOT_NAMES),
    "sensors": lambda figures: have_table(SENSOR_NAMES),
    **{name: partial(device_table, name) for name in (*ROBOT_NAMES, "jr3", *MEASURED_SENSORS, CELL)},
}
JSON_DEPTH = 1
