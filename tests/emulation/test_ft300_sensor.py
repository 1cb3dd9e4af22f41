"""Tests of the emulated FT 300: its states, its refusals, its faults, and invalid bytes."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.devices.ft300 import FT300_FAULTS, Ft300, Ft300Profile
from emulators.faults import Ledger
from emulators.seams import Floats
from emulators.sensing import KnownWrench
from protocol.devices.ft300 import STOP
from protocol.devices.ft300.messages import (
    READ,
    READ_INPUT,
    StreamReader,
    encode_exception,
    encode_read,
    encode_words,
    encode_write,
    with_crc,
)
from tests.emulation.quiet_sensor import QUIET

T0 = 100.0
LOAD = (12.34, -2.5, -98.1, 0.15, -0.025, 0.007)
COUNTS = (1234, -250, -9810, 150, -25, 7)
START, STARTED = encode_write(410, 0x0200), bytes.fromhex("0910019A00012152")


def sensor(wrench: Callable[[Floats], Floats] | None = None, **settings: Any) -> Ft300:
    steady = KnownWrench(wrench or (lambda times: np.tile(np.array(LOAD), (len(times), 1))))
    return Ft300(Ft300Profile(**{**QUIET, "boot_s": 0.0, **settings}), steady, T0, 7)


def ledger(device: Ft300) -> Ledger:
    result = Ledger(FT300_FAULTS)
    for target, handlers in device.handlers.items():
        result.attach(target, handlers)
    return result


def messages_until(device: Ft300, until: float) -> list[tuple[float, bytes]]:
    """Return the messages that it sends up to a time, each with its time."""
    result = []
    while (due := device.endpoint.next_deadline()) is not None and due <= until:
        device.endpoint.handle_deadline(due)
        if data := device.endpoint.data_to_send(due):
            result.append((due, data))
    return result


def exchange(device: Ft300, question: bytes, now: float = T0) -> bytes:
    device.endpoint.receive(question, now)
    return b"".join(data for _, data in messages_until(device, now + 0.02))


def messages(pieces: list[tuple[float, bytes]]) -> list[tuple[int, ...]]:
    return StreamReader().feed(b"".join(data for _, data in pieces))


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        (encode_read(180, 6), "09030C04D2FF06D9AE0096FFE70007DC91"),
        (
            encode_read(510, 4),
            "0903084654530004D20000" + with_crc(bytes.fromhex("0903084654530004D20000"))[-2:].hex(),
        ),
        (encode_read(514, 1), "09030207E59A3E"),
        (encode_read(500, 3), with_crc(bytes.fromhex("090306465453010000")).hex()),
        (encode_read(190, 3), with_crc(bytes.fromhex("09030600000000FC18")).hex()),
        (encode_read(410, 1), with_crc(bytes.fromhex("0903020000")).hex()),
        (encode_read(180, 1, READ_INPUT), with_crc(bytes.fromhex("09040204D2")).hex()),
        (START, "0910019A00012152"),
    ],
)
def test_queries_are_answered(question: bytes, answer: str) -> None:
    assert exchange(sensor(), question).hex() == answer.lower()


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        (encode_read(300, 1), encode_exception(READ, 2)),
        (encode_read(185, 2), encode_exception(READ, 2)),
        (encode_read(180, 0), encode_exception(READ, 3)),
        (encode_read(180, 126), encode_exception(READ, 3)),
        (encode_read(180, 6, 0x05), encode_exception(0x05, 1)),
        (encode_write(411, 0x0200), encode_exception(0x10, 2)),
        (with_crc(bytes.fromhex("0910019A0002020200")), encode_exception(0x10, 3)),
        (encode_write(410, 0), STARTED),
    ],
)
def test_invalid_queries_are_refused(question: bytes, answer: bytes) -> None:
    device = sensor()
    assert exchange(device, question) == answer
    assert messages_until(device, T0 + 1.0) == []


def test_setting_disables_functions() -> None:
    device = sensor(fc04=False, fc06=False)
    assert exchange(device, encode_read(180, 6, READ_INPUT)) == encode_exception(READ_INPUT, 1)
    assert exchange(device, with_crc(bytes.fromhex("0906019A0200")), T0 + 1.0) == encode_exception(6, 1)
    one = with_crc(bytes.fromhex("0906019A0200"))
    assert exchange(sensor(), one).startswith(one)


@pytest.mark.parametrize(
    "question",
    [with_crc(b"\x05" + encode_read(180, 6)[1:-2]), encode_read(180, 6)[:-1] + b"\0", b"", b"\xff" * 50],
)
def test_other_slaves_and_damaged_queries_get_no_answer(question: bytes) -> None:
    assert exchange(sensor(), question) == b""


def test_fragmented_query_is_answered() -> None:
    device, ask = sensor(), encode_read(514, 1)
    device.endpoint.receive(ask[:3], T0)
    assert exchange(device, ask[3:], T0 + 0.03) == encode_words(READ, [2021])
    device.endpoint.receive(ask[:3], T0 + 1.0)
    assert exchange(device, ask, T0 + 1.1) == encode_words(READ, [2021])


def test_stream_has_period_and_jitter() -> None:
    device = sensor(lambda times: np.outer(times - T0, np.ones(6)))
    device.endpoint.receive(START, T0)
    (at, answer), *pieces = messages_until(device, T0 + 1.0)
    assert (answer, at) == (STARTED, pytest.approx(T0 + 0.004))
    times = [at for at, _ in pieces]
    assert times[0] >= T0 + 0.014
    gaps = np.diff(times)
    assert (gaps.min(), gaps.max()) == (pytest.approx(0.01, abs=6e-4), pytest.approx(0.01, abs=6e-4))
    forces = [counts[0] for counts in messages(pieces)]
    assert set(np.diff(forces)) == {1}
    sampled = [device.sampled_at(k + 1) for k in range(len(forces))]
    assert [round((at - T0) * 100) for at in sampled if at is not None] == forces
    assert device.sampled_at(10_000) is None


def test_stream_ignores_all_but_its_end() -> None:
    device = sensor()
    device.endpoint.receive(START, T0)
    device.endpoint.receive(encode_read(180, 6), T0 + 0.1)
    assert set(messages(messages_until(device, T0 + 0.2)[1:])) == {COUNTS}
    device.endpoint.receive(b"\xff", T0 + 0.2)
    assert messages_until(device, T0 + 0.5) == []
    device.endpoint.receive(STOP[1:], T0 + 0.2)
    assert exchange(device, encode_read(514, 1), T0 + 0.3) == encode_words(READ, [2021])


def test_end_of_stream_may_need_more_bytes() -> None:
    device = sensor(stop_after_ff=10)
    device.endpoint.receive(START, T0)
    messages_until(device, T0 + 0.1)
    device.endpoint.receive(b"\xff" * 9 + b"\0" + b"\xff" * 9, T0 + 0.1)
    assert messages_until(device, T0 + 0.2)
    device.endpoint.receive(b"\xff", T0 + 0.2)
    assert messages_until(device, T0 + 0.5) == []


def test_sensor_may_stream_from_power_up() -> None:
    assert len(messages(messages_until(sensor(power_up="stream"), T0 + 0.2))) > 15
    assert exchange(sensor(boot_s=1.0), encode_read(514, 1)) == b""


def test_values_clip_at_word_limits() -> None:
    device = sensor(lambda times: np.tile([400.0, -400.0, 0.0, 40.0, 0.0, 0.0], (len(times), 1)))
    device.endpoint.receive(START, T0)
    assert set(messages(messages_until(device, T0 + 0.1)[1:])) == {(32767, -32768, 0, 32767, 0, 0)}


def test_each_fault_has_effect() -> None:
    def with_fault(target: str, fault: str, **parameters: object) -> list[tuple[int, ...]]:
        device = sensor()
        device.endpoint.receive(START, T0)
        messages_until(device, T0 + 0.2)
        injection = ledger(device).inject(target, fault, T0 + 0.2, parameters)
        frames = messages(messages_until(device, T0 + 1.2))
        assert injection.struck
        return frames

    assert {counts[2] for counts in with_fault("signal", "scale", axis="fz", factor=0.5)[1:]} == {-4905}
    assert len(with_fault("sensor", "slow", factor=10.0)) in (10, 11)
    assert with_fault("sensor", "unplugged") == []
    assert with_fault("sensor-wire", "off") == []
    assert with_fault("sensor", "power-cycle") == []
    assert 10 < len(with_fault("sensor-wire", "corrupted", probability=0.02)) < 95
    device = sensor()
    book = ledger(device)
    book.inject("sensor", "refuses", T0, {"code": 4})
    assert exchange(device, encode_read(514, 1)) == encode_exception(READ, 4)
    book.inject("sensor-wire", "deaf", T0 + 1.0, {})
    assert exchange(device, encode_read(514, 1), T0 + 1.0) == b""


def test_replugged_sensor_boots() -> None:
    device = sensor(boot_s=0.5)
    device.endpoint.receive(START, T0 + 1.0)
    messages_until(device, T0 + 1.1)
    book = ledger(device)
    book.inject("sensor", "unplugged", T0 + 1.1, {"for_s": 0.4})
    messages_until(device, T0 + 1.5)
    book.handle_deadline(T0 + 1.5)
    assert exchange(device, encode_read(514, 1), T0 + 1.9) == b""
    assert exchange(device, encode_read(514, 1), T0 + 2.1) == encode_words(READ, [2021])


@given(st.lists(st.binary(max_size=40), max_size=12), st.booleans())
def test_arbitrary_bytes_raise_nothing(data: list[bytes], streams: bool) -> None:
    device = sensor(power_up="stream" if streams else "modbus")
    for k, piece in enumerate(data):
        device.endpoint.receive(piece, T0 + 0.01 * k)
        device.endpoint.receive(with_crc(b"\x09" + piece), T0 + 0.01 * k)
        messages_until(device, T0 + 0.01 * k)


@pytest.mark.parametrize("settings", [{"power_up": "off"}, {"version": (1, 2)}, {"latency_s": -1.0}])
def test_invalid_settings_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must be"):
        Ft300Profile(**settings)
