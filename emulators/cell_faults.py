"""Every fault that a cell of S3 and JR3 can have, by target: one table, collected from the devices."""

from collections.abc import Mapping

from emulators.cell import OWN_FAULTS
from emulators.devices.jr3.faults import FRAMES_FAULTS, JR3_FAULTS, PLUG_FAULTS, SECOND
from emulators.devices.s3.faults import S3_FAULTS
from emulators.faults import Fault
from emulators.faults.bus import BUS_FAULTS

CELL_FAULTS: Mapping[str, Mapping[str, Fault]] = {
    **S3_FAULTS,
    **JR3_FAULTS,
    **OWN_FAULTS,
}
"""Faults by target."""

FELT_BY_SENSOR = ("signal", "scales", "frames", "sensor", "bus", "surface", "obstacle")
"""Targets that have no effect but through the emulated sensor."""

JR3_RECEIVERS = ("gateway", "uart", "board", "jr3", "jr3-uart", "jr3-board")
"""Names of the JR3's receivers, the older ones first: they share one table of faults."""

RECEIVERS: Mapping[tuple[str, str], tuple[str, ...]] = {
    **{("frames", name): ("gateway", "uart") for name in FRAMES_FAULTS if name not in PLUG_FAULTS},
    **{("bus", name): ("gateway", "ati-can") for name in BUS_FAULTS},
}
"""Which receivers of a JR3 can have a fault, where not all can; which sensors sit on a CAN bus."""

_ALSO = {"jr3": "gateway", "jr3-uart": "uart", "jr3-board": "board"}
"""Older names of the kinds."""

RECEIVERS_WITH: Mapping[tuple[str, str], tuple[str, str, tuple[str, ...]]] = {
    ("frames", "unplugged"): ("sensor", SECOND, ("board",))
}
"""Which can have a fault with a value of a parameter, where not all can: the parameter, the value, the receivers."""


def as_in_tables(sensor: str) -> str:
    """The name of an emulated sensor as these tables have it."""
    return _ALSO.get(sensor, sensor)


def others_with(on: str, fault: str, sensor: str) -> tuple[str, ...]:
    """Which emulated sensors can have a fault that this one cannot; empty where it can."""
    able = RECEIVERS.get((on, fault))
    ours = on == "bus" or sensor in JR3_RECEIVERS
    return able if able is not None and ours and as_in_tables(sensor) not in able else ()
