"""Tests of the emulated FT 300 behind its URCap: its texts, repeated values and silence, faults, and invalid bytes."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.devices.ft300 import URCAP_FAULTS, Ft300Profile, UrcapServer
from emulators.faults import Ledger
from emulators.seams import Floats
from emulators.sensing import KnownWrench
from protocol.devices.ft300.urcap import TextReader
from tests.emulation.quiet_sensor import QUIET

T0 = 100.0
LOAD = (12.34, -2.5, -98.1, 0.15, -0.025, 0.007)
TEXT = b"( 12.340000 , -2.500000 , -98.099998 , 0.150000 , -0.025000 , 0.007000 )"
RISING: Callable[[Floats], Floats] = lambda times: np.outer(times - T0, np.ones(6))  # noqa: E731


def server(wrench: Callable[[Floats], Floats] | None = None, **settings: Any) -> UrcapServer:
    steady = KnownWrench(wrench or (lambda times: np.tile(np.array(LOAD), (len(times), 1))))
    return UrcapServer(Ft300Profile(**{**QUIET, "boot_s": 0.0, **settings}), steady, T0, 7)


def timed_output(device: UrcapServer, until: float) -> list[tuple[float, bytes]]:
    """Return the texts sent up to a time, each with its time."""
    result = []
    while (due := device.endpoint.next_deadline()) is not None and due <= until:
        device.endpoint.handle_deadline(due)
        if data := device.endpoint.data_to_send(due):
            result.append((due, data))
    return result


def forces(pieces: list[tuple[float, bytes]]) -> list[float]:
    return [values[0] for values in TextReader().feed(b"".join(data for _, data in pieces))]


def ledger(device: UrcapServer) -> Ledger:
    result = Ledger(URCAP_FAULTS)
    for target, handlers in device.handlers.items():
        result.attach(target, handlers)
    return result


def test_texts_and_pace_match_makers_urcap() -> None:
    device = server()
    pieces = timed_output(device, T0 + 1.0)
    assert {data for _, data in pieces} == {TEXT}
    assert 95 <= len(pieces) <= 99
    gaps = np.diff([at for at, _ in pieces])
    assert (gaps.min(), gaps.max()) == (pytest.approx(0.0101, abs=6e-4), pytest.approx(0.0101, abs=6e-4))


def test_text_contains_newest_sample_with_time() -> None:
    device = server(RISING)
    timed_output(device, T0 + 0.5)
    device.begin()
    pieces = timed_output(device, T0 + 1.0)
    for k, ((at, _), force) in enumerate(zip(pieces, forces(pieces), strict=True)):
        sampled = device.sampled_at(k + 1)
        assert sampled is not None
        assert sampled - T0 == pytest.approx(force, abs=1e-6)
        assert 0.018 < at - sampled < 0.030
    assert device.sampled_at(10_000) is None


def test_urcap_faster_than_sensor_repeats_value() -> None:
    result = forces(timed_output(server(RISING, urcap_period_s=0.005), T0 + 1.0))
    assert len(result) == pytest.approx(195, abs=5)
    assert len(set(result)) == pytest.approx(97, abs=3)


def test_data_from_client_is_ignored() -> None:
    device = server()
    device.endpoint.receive(b"SET ZRO", T0)
    device.endpoint.receive(b"\xff" * 50, T0)
    assert len(timed_output(device, T0 + 0.5)) > 40


def test_values_clip_at_word_limits() -> None:
    device = server(lambda times: np.tile([400.0, -400.0, 0.0, 40.0, 0.0, 0.0], (len(times), 1)))
    assert {data for _, data in timed_output(device, T0 + 0.1)} == {
        b"( 327.670013 , -327.679993 , 0.000000 , 32.766998 , 0.000000 , 0.000000 )"
    }


def test_unplugged_sensor_repeats_stops_and_recovers() -> None:
    device = server(RISING, boot_s=0.5)
    assert timed_output(device, T0 + 0.4) == []
    timed_output(device, T0 + 2.0)
    book = ledger(device)
    book.inject("sensor", "unplugged", T0 + 2.0, {"for_s": 2.0})
    repeated = timed_output(device, T0 + 4.0)
    assert len(repeated) == 41
    assert len(set(forces(repeated))) == 1
    book.handle_deadline(T0 + 4.0)
    result = timed_output(device, T0 + 8.0)
    assert result[0][0] == pytest.approx(T0 + 4.0 + 0.5 + 1.5, abs=0.03)
    assert forces(result)[0] > 5.9


def test_sensor_without_supply_is_lost_and_recovers() -> None:
    device = server(RISING)
    timed_output(device, T0 + 1.0)
    ledger(device).inject("sensor", "power-cycle", T0 + 1.0, {})
    times = [at for at, _ in timed_output(device, T0 + 5.0)]
    assert max(np.diff(times)) == pytest.approx(1.5, abs=0.05)


def test_each_fault_has_effect() -> None:
    def with_fault(target: str, fault: str, **parameters: object) -> list[float]:
        device = server(RISING)
        timed_output(device, T0 + 0.2)
        injection = ledger(device).inject(target, fault, T0 + 0.2, parameters)
        readings = forces(timed_output(device, T0 + 1.2))
        assert injection.struck
        return readings

    assert len(set(with_fault("sensor", "slow", factor=10.0))) in (10, 11)
    assert max(with_fault("signal", "scale", axis="fx", factor=0.5)) == pytest.approx(0.59, abs=0.02)
    assert with_fault("sensor-wire", "off") == []
    assert len(with_fault("sensor-wire", "malformed", probability=0.5)) == pytest.approx(50, abs=12)
    assert len(with_fault("sensor-wire", "twice", probability=0.5)) == pytest.approx(150, abs=15)
    assert min(np.diff(with_fault("sensor-wire", "reordered", probability=0.5))) < 0.0


@given(st.lists(st.binary(max_size=40), max_size=12))
def test_arbitrary_bytes_raise_nothing(data: list[bytes]) -> None:
    device = server()
    for k, piece in enumerate(data):
        device.endpoint.receive(piece, T0 + 0.01 * k)
        timed_output(device, T0 + 0.01 * k)
