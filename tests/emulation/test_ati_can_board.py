"""Tests of the emulated NETCANOEM board: its answers, its refusals, its faults, and invalid frames."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.devices.ati_can import ATI_CAN_FAULTS, AtiCanBoard, AtiCanProfile
from emulators.faults import Ledger
from emulators.seams import Floats
from emulators.sensing import KnownWrench
from protocol.can.frame import CanFrame
from protocol.can.text import parse_frame
from protocol.devices.ati_can.messages import decode_sample, decode_sample_rest
from tests.emulation.quiet_sensor import SETTLED

T0 = 100.0
LOAD = (1.0, -2.0, 10.0, 0.1, -0.2, 0.05)


def board(wrench: Callable[[Floats], Floats] | None = None, **settings: Any) -> AtiCanBoard:
    steady = KnownWrench(wrench or (lambda times: np.tile(np.array(LOAD), (len(times), 1))))
    return AtiCanBoard(
        AtiCanProfile(**{"noise_gages": 0.0, "boot_s": 0.0, **SETTLED, **settings}), steady, T0, 7
    )


def ledger(device: AtiCanBoard) -> Ledger:
    result = Ledger(ATI_CAN_FAULTS)
    for target, handlers in device.handlers.items():
        result.attach(target, handlers)
    return result


def answers(device: AtiCanBoard, question: str, now: float = T0) -> list[str]:
    device.endpoint.receive([parse_frame(question)], now)
    result: list[str] = []
    while (due := device.endpoint.next_deadline()) is not None:
        device.endpoint.handle_deadline(due)
        result += [str(frame) for frame in device.endpoint.data_to_send(due)]
    return result


def gages(device: AtiCanBoard, now: float = T0) -> tuple[int, list[int]]:
    """Return status and gages 0 … 5 of a sample."""
    one, two = (parse_frame(text) for text in answers(device, "200#", now))
    start, rest = decode_sample(one.data), decode_sample_rest(two.data)
    return start.status, [gage for pair in zip(start.gages, rest, strict=True) for gage in pair]


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("202#00", ["202#C13B15B8C0562E53", "203#42031B1BC467A959", "204#421A13B6446585E2"]),
        ("202#03", ["202#3EBFE23F40C15948", "203#C1B421CBC01D06A9", "204#41B46957C04C953A"]),
        ("205#", ["205#4654343437320000"]),
        ("206#00", ["206#00"]),
        ("206#0FFF", ["206#0F"]),
        ("207#", ["207#000F4240000F4240"]),
        ("208#", ["208#0203"]),
        ("209#02", ["209#0800"]),
        ("20F#", ["20F#03080002"]),
        ("20E#03", ["20E#"]),
        ("20D#21", ["20D#"]),
        ("20C#", []),
        *(
            (text, [])
            for text in ("202#", "202#06", "206#", "206#10", "209#06", "20D#80", "20E#", "20A#", "201#")
        ),
        *((text, []) for text in ("210#", "200#R", "00000200#")),
    ],
)
def test_queries_are_answered(question: str, answer: list[str]) -> None:
    assert answers(board(), question) == answer


def test_answer_is_delayed() -> None:
    device = board(turnaround_s=0.001)
    device.endpoint.receive([CanFrame(0x200)], T0)
    assert device.endpoint.data_to_send(T0 + 0.0009) == []
    assert device.endpoint.next_deadline() == T0 + 0.001
    assert len(device.endpoint.data_to_send(T0 + 0.001)) == 2


def test_gages_encode_wrench() -> None:
    device = board(offset_gages=500)
    status, reported = gages(device)
    wrench = device.profile.coefficients @ (np.array(reported) - 500) * 1e-6
    assert status == 0
    assert wrench == pytest.approx(LOAD, abs=2e-3)
    assert device.sampled_at(1) == pytest.approx(T0)
    assert device.sampled_at(2) is None


def test_gage_saturates_at_word_limit() -> None:
    _, reported = gages(board(lambda times: np.tile([0.0, 0.0, 400.0, 0.0, 0.0, 0.0], (len(times), 1))))
    assert min(reported) == -32768


def test_empty_slot_is_echoed_and_reported_in_status() -> None:
    device = board()
    assert answers(device, "206#03") == ["206#03"]
    assert gages(device, T0 + 1.0)[0] == 0x8040
    answers(device, "20C#", T0 + 2.0)
    assert gages(device, T0 + 3.0)[0] == 0


def test_new_base_applies_after_power_cycle() -> None:
    device = board()
    answers(device, "20D#21")
    answers(device, "20C#", T0 + 1.0)
    assert answers(device, "20F#", T0 + 2.0)
    ledger(device).inject("sensor", "power-cycle", T0 + 3.0, {})
    assert answers(device, "20F#", T0 + 4.0) == []
    assert answers(device, "21F#", T0 + 4.0) == ["21F#03080002"]
    device = board(reset_applies=True)
    answers(device, "20D#21")
    answers(device, "20C#", T0 + 1.0)
    assert answers(device, "21F#", T0 + 2.0)


def test_older_firmware_supports_fewer_requests() -> None:
    device = board(firmware=(3, 6, 1))
    assert (answers(device, "208#"), answers(device, "209#00")) == ([], [])


def test_board_ignores_requests_during_boot() -> None:
    device = board(boot_s=0.5)
    assert answers(device, "20F#", T0 + 0.4) == []
    assert answers(device, "20F#", T0 + 0.6)
    answers(device, "20C#", T0 + 1.0)
    assert answers(device, "20F#", T0 + 1.4) == []


def test_each_fault_has_effect() -> None:
    def with_fault(target: str, fault: str, **parameters: object) -> tuple[AtiCanBoard, Any]:
        device = board()
        return device, ledger(device).inject(target, fault, T0 + 1.0, parameters)

    def reported_with(device: AtiCanBoard, injection: Any) -> tuple[int, list[int]]:
        result = gages(device, T0 + 2.0)
        assert injection.struck
        return result

    assert reported_with(*with_fault("sensor", "unplugged", for_s=5.0)) == (0, [32767] * 6)
    assert reported_with(*with_fault("sensor", "status", bit=5))[0] == 0x8020
    assert reported_with(*with_fault("sensor", "watchdog"))[0] == 0x8001
    device, injection = with_fault("signal", "sign", axis="fz")
    wrench = device.profile.coefficients @ np.array(reported_with(device, injection)[1]) * 1e-6
    assert wrench[2] == pytest.approx(-10.0, abs=2e-3)
    device, _ = with_fault("sensor", "wrong-scales", factor=0.5, of="forces")
    assert answers(device, "207#", T0 + 2.0) == ["207#001E8480000F4240"]
    device, _ = with_fault("sensor-wire", "late", ms=50.0, way="from")
    device.endpoint.receive([CanFrame(0x20F)], T0 + 2.0)
    assert device.endpoint.data_to_send(T0 + 2.001) == []
    assert device.endpoint.next_deadline() == pytest.approx(T0 + 2.051)
    device, _ = with_fault("sensor-wire", "off")
    assert answers(device, "20F#", T0 + 2.0) == []
    device, _ = with_fault("sensor", "other-host", slot=1)
    assert [str(frame) for frame in device.endpoint.data_to_send(T0 + 1.0)] == ["206#01"] * 2
    device = board()
    with pytest.raises(ValueError, match=r"no noise; set cell\.ati_can\.noise_gages"):
        ledger(device).inject("signal", "noise", T0, {})


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=30))
def test_arbitrary_frames_raise_nothing(data: list[tuple[int, bytes]]) -> None:
    device = board()
    for k, (number, payload) in enumerate(data):
        answers(device, str(CanFrame(number, payload)), T0 + 0.01 * k)
        answers(device, str(CanFrame(0x200 | number & 0xF, payload)), T0 + 0.01 * k)


@pytest.mark.parametrize(
    "settings",
    [
        {"matrix": (1.0,) * 35},
        {"matrix": (1.0,) * 36},
        {"matrix": (float("nan"),) * 36},
        {"serial": "too long a number"},
        {"firmware": (1, 2)},
        {"base": 128},
    ],
)
def test_invalid_settings_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must be"):
        AtiCanProfile(**settings)
