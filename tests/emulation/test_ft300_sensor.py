"""The emulated FT 300: its states, its refusals, its faults, and hostile bytes."""

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
    found = Ledger(FT300_FAULTS)
    for target, handlers in device.handlers.items():
        found.attach(target, handlers)
    return found


def told(device: Ft300, until: float) -> list[tuple[float, bytes]]:
    """The messages that it sends up to a time, each with its time."""
    found = []
    while (due := device.endpoint.next_deadline()) is not None and due <= until:
        device.endpoint.handle_deadline(due)
        if data := device.endpoint.data_to_send(due):
            found.append((due, data))
    return found


def answered(device: Ft300, question: bytes, now: float = T0) -> bytes:
    device.endpoint.receive(question, now)
    return b"".join(data for _, data in told(device, now + 0.02))


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
def test_questions_and_their_answers(question: bytes, answer: str) -> None:
    assert answered(sensor(), question).hex() == answer.lower()


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
def test_what_is_refused_and_how(question: bytes, answer: bytes) -> None:
    device = sensor()
    assert answered(device, question) == answer
    assert told(device, T0 + 1.0) == []


def test_functions_that_a_setting_takes_away() -> None:
    device = sensor(fc04=False, fc06=False)
    assert answered(device, encode_read(180, 6, READ_INPUT)) == encode_exception(READ_INPUT, 1)
    assert answered(device, with_crc(bytes.fromhex("0906019A0200")), T0 + 1.0) == encode_exception(6, 1)
    one = with_crc(bytes.fromhex("0906019A0200"))
    assert answered(sensor(), one).startswith(one)


@pytest.mark.parametrize(
    "question",
    [with_crc(b"\x05" + encode_read(180, 6)[1:-2]), encode_read(180, 6)[:-1] + b"\0", b"", b"\xff" * 50],
)
def test_other_slaves_and_damaged_questions_get_silence(question: bytes) -> None:
    assert answered(sensor(), question) == b""


def test_a_question_in_pieces_is_answered_and_an_old_piece_is_forgotten() -> None:
    device, ask = sensor(), encode_read(514, 1)
    device.endpoint.receive(ask[:3], T0)
    assert answered(device, ask[3:], T0 + 0.03) == encode_words(READ, [2021])
    device.endpoint.receive(ask[:3], T0 + 1.0)
    assert answered(device, ask, T0 + 1.1) == encode_words(READ, [2021])


def test_a_stream_runs_at_its_period_with_its_jitter() -> None:
    device = sensor(lambda times: np.outer(times - T0, np.ones(6)))
    device.endpoint.receive(START, T0)
    (at, answer), *pieces = told(device, T0 + 1.0)
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


def test_a_stream_hears_nothing_but_its_end() -> None:
    device = sensor()
    device.endpoint.receive(START, T0)
    device.endpoint.receive(encode_read(180, 6), T0 + 0.1)
    assert set(messages(told(device, T0 + 0.2)[1:])) == {COUNTS}
    device.endpoint.receive(b"\xff", T0 + 0.2)
    assert told(device, T0 + 0.5) == []
    device.endpoint.receive(STOP[1:], T0 + 0.2)
    assert answered(device, encode_read(514, 1), T0 + 0.3) == encode_words(READ, [2021])


def test_more_bytes_may_be_needed_to_end_it() -> None:
    device = sensor(stop_after_ff=10)
    device.endpoint.receive(START, T0)
    told(device, T0 + 0.1)
    device.endpoint.receive(b"\xff" * 9 + b"\0" + b"\xff" * 9, T0 + 0.1)
    assert told(device, T0 + 0.2)
    device.endpoint.receive(b"\xff", T0 + 0.2)
    assert told(device, T0 + 0.5) == []


def test_it_may_stream_from_its_power_up_on() -> None:
    assert len(messages(told(sensor(power_up="stream"), T0 + 0.2))) > 15
    assert answered(sensor(boot_s=1.0), encode_read(514, 1)) == b""


def test_it_clips_at_the_end_of_its_words() -> None:
    device = sensor(lambda times: np.tile([400.0, -400.0, 0.0, 40.0, 0.0, 0.0], (len(times), 1)))
    device.endpoint.receive(START, T0)
    assert set(messages(told(device, T0 + 0.1)[1:])) == {(32767, -32768, 0, 32767, 0, 0)}


def test_each_fault_has_its_effect() -> None:
    def with_fault(target: str, fault: str, **parameters: object) -> list[tuple[int, ...]]:
        device = sensor()
        device.endpoint.receive(START, T0)
        told(device, T0 + 0.2)
        injection = ledger(device).inject(target, fault, T0 + 0.2, parameters)
        found = messages(told(device, T0 + 1.2))
        assert injection.struck
        return found

    assert {counts[2] for counts in with_fault("signal", "scale", axis="fz", factor=0.5)[1:]} == {-4905}
    assert len(with_fault("sensor", "slow", factor=10.0)) in (10, 11)
    assert with_fault("sensor", "unplugged") == []
    assert with_fault("sensor-wire", "off") == []
    assert with_fault("sensor", "power-cycle") == []
    assert 10 < len(with_fault("sensor-wire", "corrupted", probability=0.02)) < 95
    device = sensor()
    book = ledger(device)
    book.inject("sensor", "refuses", T0, {"code": 4})
    assert answered(device, encode_read(514, 1)) == encode_exception(READ, 4)
    book.inject("sensor-wire", "deaf", T0 + 1.0, {})
    assert answered(device, encode_read(514, 1), T0 + 1.0) == b""


def test_a_sensor_that_is_plugged_in_again_boots() -> None:
    device = sensor(boot_s=0.5)
    device.endpoint.receive(START, T0 + 1.0)
    told(device, T0 + 1.1)
    book = ledger(device)
    book.inject("sensor", "unplugged", T0 + 1.1, {"for_s": 0.4})
    told(device, T0 + 1.5)
    book.handle_deadline(T0 + 1.5)
    assert answered(device, encode_read(514, 1), T0 + 1.9) == b""
    assert answered(device, encode_read(514, 1), T0 + 2.1) == encode_words(READ, [2021])


@given(st.lists(st.binary(max_size=40), max_size=12), st.booleans())
def test_no_bytes_raise(data: list[bytes], streams: bool) -> None:
    device = sensor(power_up="stream" if streams else "modbus")
    for k, piece in enumerate(data):
        device.endpoint.receive(piece, T0 + 0.01 * k)
        device.endpoint.receive(with_crc(b"\x09" + piece), T0 + 0.01 * k)
        told(device, T0 + 0.01 * k)


@pytest.mark.parametrize("settings", [{"power_up": "off"}, {"version": (1, 2)}, {"latency_s": -1.0}])
def test_settings_that_cannot_be_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must be"):
        Ft300Profile(**settings)
