"""Tests of parts common to all emulated sensors: converter, signal faults, own faults, a faulty datagram wire."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.faults import Ledger
from emulators.faults.kinds import FOREVER, Fault
from emulators.faults.ledger import Handler
from emulators.faults.own import OwnFaults
from emulators.faults.packets import DATAGRAMS, SENSOR_WIRE
from emulators.sensing import Converter, KnownWrench, MeasuredWrench
from emulators.sensing.faults import SIGNAL_FAULTS
from tests.emulation.bad_wire import BadWire

RATE = 100.0


def measured(noise: float = 0.0, end: float = 1e6, seed: int = 7) -> tuple[MeasuredWrench, KnownWrench]:
    """Return a sensor with 10 counts per N and N·m whose load rises by 1 N/s on fx, and less on the others."""
    source = KnownWrench(lambda times: np.outer(times, [1.0, 0.9, 0.8, 0.7, 0.6, 0.5]))
    converter = Converter(np.eye(6) * 10.0, np.full(6, noise), np.full(6, -end), np.full(6, end), offset=3.0)
    return MeasuredWrench(source, RATE, converter, seed, "" if noise else "its noise"), source


def signal_book(sensor: MeasuredWrench) -> Ledger:
    book = Ledger({"signal": SIGNAL_FAULTS})
    book.attach("signal", sensor.signal.handlers)
    return book


def test_outputs_are_integers_with_offset_and_limits() -> None:
    sensor, _ = measured(end=20.0)
    outputs = sensor.outputs(0, 300)
    assert outputs[:, 0].tolist() == [min(round(k / 10 + 3.0), 20) for k in range(301)]
    assert sensor.last_at_end(0, 300) == 300
    assert sensor.last_at_end(0, 159) is None
    assert sensor.last_at_end(100, 171) == 171
    assert (sensor.number_at(1.0), sensor.first_after(1.0), sensor.number_at(0.999)) == (100, 101, 99)


def test_recomputed_sample_is_no_longer_clipped() -> None:
    load = [1.0]
    source = KnownWrench(
        lambda times: np.full((len(times), 6), load[0]), predicted_until=lambda now: now + 1.0
    )
    converter = Converter(np.eye(6), np.zeros(6), np.full(6, -9.0), np.full(6, 9.0))
    sensor = MeasuredWrench(source, RATE, converter, 7, "its noise")
    load[0] = 20.0
    sensor.outputs(0, 10)
    load[0] = 1.0
    source.on_change(0.045)
    sensor.outputs(0, 10)
    assert (sensor.last_at_end(0, 3), sensor.last_at_end(4, 10)) == (3, None)


@given(st.lists(st.integers(1, 40), min_size=1, max_size=12), st.sampled_from(sorted(SIGNAL_FAULTS)))
def test_fault_is_independent_of_blocks(sizes: list[int], fault: str) -> None:
    (complete, _), (pieces, _) = measured(2.0), measured(2.0)
    for sensor in (complete, pieces):
        signal_book(sensor).inject("signal", fault, 0.5, {})
    total, result, first = sum(sizes), [], 0
    for size in sizes:
        result.append(pieces.outputs(first, first + size - 1))
        first += size
    assert np.array_equal(np.concatenate(result), complete.outputs(0, total - 1))


@pytest.mark.parametrize("fault", sorted(SIGNAL_FAULTS))
def test_signal_fault_changes_samples_from_its_start_only(fault: str) -> None:
    clean, (broken, _) = measured(2.0)[0].outputs(0, 199), measured(2.0)
    how = {"stuck": {}, "replayed": {"for_s": 0.5, "length_s": 0.1}}.get(fault, {"for_s": 0.5})
    injection = signal_book(broken).inject("signal", fault, 1.0, how)
    outputs = broken.outputs(0, 199)
    changed = np.flatnonzero((outputs != clean).any(axis=1))
    assert len(changed)
    assert changed.min() >= (110 if fault == "replayed" else 100), (
        "what is replayed is first taken in, unchanged"
    )
    assert fault == "stuck" or changed.max() < 150
    assert injection.struck


def test_noise_fault_without_noise_is_refused() -> None:
    with pytest.raises(ValueError, match="this sensor has no noise; set its noise"):
        signal_book(measured()[0]).inject("signal", "noise", 0.0, {})


def test_own_faults_strike_last_and_end() -> None:
    own, struck, ended = OwnFaults(), list[float](), list[float]()
    book = Ledger(
        {"sensor": {"once": Fault("", {}), "long": Fault("", {}, FOREVER), "short": Fault("", {}, 2.0)}}
    )
    handlers: dict[str, Handler] = {
        **own.striking({"once": struck.append}),
        **own.held(("long",)),
        **own.ended_by("short", ended.append),
    }
    book.attach("sensor", handlers)
    once, long, short = (book.inject("sensor", name, 1.0, {}) for name in ("once", "long", "short"))
    assert (struck, once.ended_at, once.struck) == ([1.0], 1.0, 1)
    assert own.under_way("long", 0.5) is None
    assert own.under_way("long", 100.0) is long
    assert own.under_way("other", 1.0) is None
    assert own.under_way("short", 2.0) is short
    book.handle_deadline(3.0)
    assert (ended, own.under_way("short", 3.0)) == ([3.0], None)
    assert (long.struck, short.struck) == (1, 1)


SENT = [bytes([k]) * 20 for k in range(100)]


def damaged(fault: str, **parameters: object) -> list[bytes]:
    """Return the datagrams of a hundred that arrive at once."""
    wire = BadWire(DATAGRAMS, 7)
    book = Ledger({SENSOR_WIRE: DATAGRAMS.faults})
    book.attach(SENSOR_WIRE, wire.handlers)
    book.inject(SENSOR_WIRE, fault, 0.0, parameters)
    return list(wire.outgoing(SENT, 0.5))


@pytest.mark.parametrize(
    ("fault", "parameters", "holds"),
    [
        ("off", {}, lambda came: came == []),
        ("lost", {"probability": 0.5}, lambda came: 30 < len(came) < 70 and set(came) < set(SENT)),
        ("twice", {"probability": 1.0}, lambda came: len(came) == 200),
        ("late", {"ms": 100.0}, lambda came: came == []),
        ("lost", {"probability": 1.0, "count": 3}, lambda came: came == SENT[3:]),
        ("garbled", {}, lambda came: [len(one) for one in came] == [20] * 100 and came != SENT),
        (
            "corrupted",
            {"probability": 1.0},
            lambda came: (
                [
                    sum((a ^ b).bit_count() for a, b in zip(one, sent, strict=True))
                    for one, sent in zip(came, SENT, strict=True)
                ]
                == [1] * 100
            ),
        ),
        ("malformed", {}, lambda came: came == [one[:10] for one in SENT]),
        ("malformed", {"count": 2}, lambda came: [len(one) for one in came[:3]] == [10, 10, 20]),
        ("reordered", {}, lambda came: came[:4] == [SENT[1], SENT[0], SENT[3], SENT[2]]),
        ("reordered", {"count": 1}, lambda came: came == [SENT[1], SENT[0], *SENT[2:]]),
        ("mute", {}, lambda came: came == []),
        ("deaf", {}, lambda came: came == SENT),
    ],
)
def test_wire_faults_damage_datagrams(
    fault: str, parameters: dict[str, object], holds: Callable[[list[bytes]], bool]
) -> None:
    assert holds(damaged(fault, **parameters))


def test_empty_datagram_cannot_be_damaged() -> None:
    wire = BadWire(DATAGRAMS, 7)
    book = Ledger({SENSOR_WIRE: DATAGRAMS.faults})
    book.attach(SENSOR_WIRE, wire.handlers)
    book.inject("sensor-wire", "corrupted", 0.0, {"probability": 1.0})
    assert list(wire.incoming([b""], 0.5)) == [b""]
