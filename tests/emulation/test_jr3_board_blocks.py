"""Tests that computing in blocks and predicting committed samples does not change the board's words."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.devices.jr3.board import BoardProfile
from emulators.devices.jr3.sensor import SensorProfile
from protocol.devices.jr3.board import (
    Link,
    LinkType,
    LoadEnvelope,
    Threshold,
    encode_envelope,
    encode_transform,
)
from tests.emulation.jr3_board_host import Floats, put
from tests.emulation.jr3_board_samples import FULL, POWERED, board_of


def noisy(times: Floats) -> Floats:
    return np.outer(np.sin(40.0 * times), FULL)


WRITES = st.lists(
    st.tuples(
        st.floats(0.0, 0.05),
        st.sampled_from(
            [
                (0x88, 900),
                (0x8B, -900),
                (0x7F, 0xA8),
                (0xE2, 0x90),
                (0xE3, 3),
                (0xE4, 2),
                (0xF2, 5),
                (0x6F, 1),
                (0xE0, 12000),
                (0xE7, 0x0501),
                (0xE7, 0x0800),
                (0xE7, 0x0B00),
                (0xE7, 0x0C00),
                (0xE7, 0x0909),
                (0x81, 50),
                (0xE7, 0x0A00),
                (None, 0),
            ]
        ),
    ),
    max_size=12,
)


@settings(max_examples=40, deadline=None)
@given(WRITES, st.floats(0.0, 0.4))
def test_prediction_reads_no_sample_twice(
    writes: list[tuple[float, tuple[int | None, int]]], certain: float
) -> None:
    requested: list[float] = []

    def wrench_at(times: Floats) -> Floats:
        requested.extend(times.tolist())
        return noisy(times)

    sensor = SensorProfile(noise_counts=1.5)
    profile = BoardProfile(offsets_zeroed_s=0.1)
    plain = board_of(noisy, profile, sensor)
    ahead = board_of(wrench_at, profile, sensor, lambda now: now + certain)
    now = POWERED + 0.06
    envelope = encode_envelope(LoadEnvelope(3, (Threshold(0x98, 5000, 1), Threshold(0x9A, 9000, 2))))
    for board in (plain, ahead):
        put(board, "transform1", encode_transform([Link(LinkType.ROTATE_Y, 3000)]), now)
        put(board, "load_envelope1", envelope, now)
    for wait, (address, value) in writes:
        now += wait
        for board in (plain, ahead):
            if address is None:
                board.unplug(now)
                board.plug_in(now)
            else:
                board.write_word(address, value, now)
        assert plain.read(0, 0x300, now) == ahead.read(0, 0x300, now)
    now += 0.03
    assert plain.read(0, 0x300, now) == ahead.read(0, 0x300, now)
    assert all(np.diff(requested) > 0)
    assert not requested or requested[-1] <= now + certain + 1e-9


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(0.0, 0.5), max_size=10))
def test_words_are_independent_of_read_times(waits: list[float]) -> None:
    sensor = SensorProfile(noise_counts=1.5)
    often, once = (board_of(noisy, BoardProfile(offsets_zeroed_s=0.3), sensor) for _ in range(2))
    now = POWERED
    for wait in waits:
        now += wait
        often.read(0x90, 98, now)
    assert often.read(0, 0x300, now) == once.read(0, 0x300, now)


def test_polling_host_reads_certain_sensor_seldom() -> None:
    calls = []

    def wrench_at(times: Floats) -> Floats:
        calls.append(len(times))
        return noisy(times)

    board = board_of(wrench_at, sensor=SensorProfile(), committed_until=lambda now: POWERED + 1.0)
    for k in range(1000):
        board.read(0x90, 98, POWERED + k / 1000)
    assert sum(calls) < 8000
    assert len(calls) < 15


def test_source_committed_forever_is_read_once() -> None:
    board = board_of(noisy, committed_until=lambda now: float("inf"))
    assert board.read(0x90, 98, POWERED + 1.0) == board_of(noisy).read(0x90, 98, POWERED + 1.0)
