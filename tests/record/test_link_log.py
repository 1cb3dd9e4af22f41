"""Log of a wire, as stored in a record."""

from typing import Any

import pytest

from hil_bridge.record import LinkLog
from hil_bridge.transports import Direction
from protocol.can.frame import CanFrame
from protocol.datagram import Datagram

SENT, RECEIVED = Direction.SENT, Direction.RECEIVED


@pytest.fixture
def entries() -> list[tuple[float, tuple[str, ...]]]:
    return []


@pytest.fixture
def log(entries: list[Any]) -> LinkLog:
    return LinkLog(lambda at, pieces: entries.append((at, pieces)))


def test_link_log_frame_is_complete(log: LinkLog, entries: list[Any]) -> None:
    frames = [
        CanFrame(0x601, bytes(8)),
        CanFrame(0x601, b"\x01", extended=True),
        CanFrame(0x123, remote=True),
        CanFrame(0x123, bytes(2), remote=True),
        CanFrame(0x4, bytes(8), error=True),
    ]
    log.take(100.0, SENT, frames)
    log.flush()
    text = "601#0000000000000000 00000601#01 123#R 123#R2 004!0000000000000000"
    assert entries == [(100.0, (f"0.000000 tx {text}",))]


def test_link_log_frames_keep_arrival_times(log: LinkLog, entries: list[Any]) -> None:
    log.take(100.0, SENT, [CanFrame(0x401)])
    frames = [CanFrame(0x601, received_at=99.9995), CanFrame(0x681, received_at=99.9995)]
    log.take(100.001, RECEIVED, [*frames, CanFrame(0x601, received_at=100.0005), CanFrame(0x7)])
    log.flush()
    pieces = ("0.000000 tx 401#", "-0.000500 rx 601# 681#", "0.000500 rx 601#", "0.001000 rx 007#")
    assert entries == [(100.0, pieces)]


def test_link_log_datagrams_are_hexadecimal(log: LinkLog, entries: list[Any]) -> None:
    log.take(1.0, RECEIVED, [Datagram(b"\x10\x02"), Datagram(b"\xff")])
    log.flush()
    assert entries == [(1.0, ("0.000000 rx 1002 ff",))]


def test_link_log_old_pieces_are_put(log: LinkLog, entries: list[Any]) -> None:
    log.take(1.0, SENT, b"\x05")
    log.age(1.5)
    assert entries == []
    log.age(1.6)
    assert entries == [(1.0, ("0.000000 tx 05",))]
    log.age(9.0)
    assert len(entries) == 1


def test_link_log_may_age_another_log_during_put() -> None:
    reported: list[str] = []
    logs: dict[str, LinkLog] = {}

    def put(name: str, at: float) -> None:
        for log in logs.values():
            log.age(at)
        reported.append(name)

    logs["robot"] = LinkLog(lambda at, pieces: put("robot", at))
    logs["sensor"] = LinkLog(lambda at, pieces: put("sensor", at))
    logs["robot"].take(1.0, SENT, b"\x05")
    logs["sensor"].take(2.0, SENT, b"\x06")
    logs["sensor"].flush()
    assert reported == ["robot", "sensor"]
