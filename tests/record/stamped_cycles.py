"""Cycles with known hops, and recordings of them."""

import json
from typing import Any

from hil_bridge.devices.facts import Devices, Sensor
from hil_bridge.record import CycleRecord, Recording, TruthRecord
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import dump, read_config
from protocol.devices.jr3 import facts_of
from tests.record.written_recordings import cycle_of

CHARACTER = 11 / 9600
MOVE_ANSWER = (8 + 5 + 4) * CHARACTER
STATUS_ANSWER = (8 + 24 + 5 + 4) * CHARACTER
"""Time of 8 bytes header, 24 bytes status, 5 around a telegram, and ENQ, ACK, ACK, EOT; specification, section 5."""


def cycle(number: int, at: float, **changes: Any) -> CycleRecord:
    """Return a cycle with known hops: status line 20 ms, its turnaround 10, then 2, 3, 4, 5, 6, 70 and 12 ms."""
    status_at = at + 0.030 + STATUS_ANSWER
    transmitted_at = status_at + 0.082
    values: dict[str, Any] = {
        "cycle": number,
        "phase": "track",
        "started_at": at,
        "status_transmitted_at": at + 0.020,
        "status_at": status_at,
        "sensor_at": status_at - 0.005,
        "decoded_at": status_at - 0.003,
        "proposed_at": status_at + 0.003,
        "controlled_at": status_at + 0.007,
        "sent_at": status_at + 0.012,
        "transmitted_at": transmitted_at,
        "answered_at": transmitted_at + 0.012 + MOVE_ANSWER,
        "sensor_sequence": 100 + number,
        "force": 10.0,
        "force_reference": 10.0,
    }
    return cycle_of(**(values | changes))


def truth(of: CycleRecord, motion: float = 0.030, sample: float = 0.001) -> TruthRecord:
    """Return a truth record: sampled `sample` before the frame's arrival, in motion `motion` after the order's last
    character.
    """
    return TruthRecord(
        of.cycle,
        of.answered_at,
        of.sample.sensor_at - sample,
        of.transmitted_at + motion,
        (0.0,) * 3,
        (0.0,) * 3,
        (0.0,) * 6,
    )


def recording(cycles: tuple[CycleRecord, ...], baudrate: int = 9600, **more: Any) -> Recording:
    robot = Setup(read_config({"robot": {"s3": {"link": {"baudrate": baudrate}}}})).facts
    devices = Devices(robot, Sensor("jr3", facts_of((115.0, 111.0, 185.0, 5.6, 5.2, 6.1), 0.01, 0.0159)))
    metadata, end = {"config": dump(read_config({}))}, {"line_floor_s": json.dumps(robot.line_floor_s)}
    return Recording(cycles, metadata=metadata, end=end, devices=devices.as_metadata(), **more)


CYCLES = tuple(cycle(k, 50.0 + 0.3 * k) for k in range(40))
