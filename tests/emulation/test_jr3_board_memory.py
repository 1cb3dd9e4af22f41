"""Tests of the board from the view of a host: power-up, words, plug, saturation."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.devices.jr3.board import BoardProfile
from emulators.devices.jr3.sensor import SensorProfile
from protocol.devices.jr3.board import MEMORY_WORDS, CommandCode, Errors, Warnings
from protocol.endpoint import RemoteProtocolError
from tests.emulation.jr3_board_host import (
    LOAD,
    LOAD_COUNTS,
    POWERED,
    STEADY,
    Floats,
    board_of,
    constant,
    do,
    get,
    loaded_from,
    put,
)

# --- power-up


def test_power_up_reads_calibration_and_reports_sensor() -> None:
    board = board_of(constant(*LOAD))
    assert get(board, "model_no", POWERED)[0] == 0
    assert get(board, "errors", POWERED + 0.04)[0] == Errors.CALIBRATION_CRC | Errors.SYSTEM_BUSY
    assert get(board, "filter0", POWERED + 0.04) == (0,) * 8
    at = POWERED + 0.06
    assert get(board, "errors", at) == (0,)
    assert [get(board, name, at)[0] for name in ("model_no", "serial_no", "units", "bits", "last_crc")] == [
        *(1, 1001, 1, 16, 0),
    ]
    assert get(board, "default_fs", at) == (115, 111, 185, 56, 52, 61)
    assert get(board, "full_scale", at) == (115, 111, 185, 56, 52, 61, 185, 61)
    assert get(board, "filter0", at)[:6] == LOAD_COUNTS
    text = "".join(chr(word >> 8) for word in get(board, "copyright", at))
    assert text.rstrip("\0") == "Emulated JR3 receiver"
    assert get(board, "thickness", at) == (318,)


def test_board_zeroes_offsets_once() -> None:
    board = board_of(constant(*LOAD))
    zeroed = POWERED + 0.02 + 0.033 + 2.0
    assert get(board, "filter0", zeroed - 1e-3)[:6] == LOAD_COUNTS
    assert get(board, "offsets", zeroed - 1e-3) == (0,) * 6
    assert get(board, "offsets", zeroed + 1e-3) == LOAD_COUNTS
    assert get(board, "filter0", zeroed + 1e-3)[:6] == (0,) * 6
    assert get(board, "offsets", zeroed + 60.0) == LOAD_COUNTS


def test_reset_clears_words_of_host() -> None:
    board = board_of(constant(*LOAD))
    put(board, "transform3", (3, 100, 0), STEADY)
    board.reset(STEADY)
    assert get(board, "model_no", STEADY)[0] == 0
    assert get(board, "count1", STEADY + 0.02)[0] == 0
    assert get(board, "transform3", STEADY + 0.1)[:2] == (0, 0)
    assert get(board, "filter0", STEADY + 0.1)[:6] == LOAD_COUNTS


@pytest.mark.parametrize(
    ("units", "words"),
    [
        (0, (26, 25, 42, 50, 46, 54)),
        (1, (115, 111, 185, 56, 52, 61)),
        (2, (117, 113, 189, 57, 53, 62)),
    ],
)
def test_full_scales_use_board_units(units: int, words: tuple[int, ...]) -> None:
    """By hand: 115 N = 25.85 lb, 5.6 N·m = 49.6 in·lb, 115 N = 11.73 kgf, 5.6 N·m = 57.1 kgf·cm."""
    board = board_of(constant(*LOAD), BoardProfile(units=units))  # type: ignore[arg-type]
    assert get(board, "default_fs", POWERED + 0.1) == words


def test_start_up_sequence_of_kernel_driver() -> None:
    """Steps and time limits are those of Linux's jr3_pci."""
    board = board_of(loaded_from(STEADY + 20.0), sensor=SensorProfile(noise_counts=0.0))
    board.reset(STEADY)
    now, good = STEADY + 0.025, 0
    while good < 11:
        healthy = not get(board, "errors", now)[0] & Errors.WATCH_DOG
        good += healthy and get(board, "model_no", now)[0] != 0 and get(board, "serial_no", now)[0] != 0
        now += 1.0
    put(board, "transform0", (0, 0), now)
    for code, patience in ((0x0500, 0.02), (0x0A00, 0.02), (0x0600, 0.04)):
        if code == 0x0A00:
            put(board, "full_scale", get(board, "max_full_scale", now), now)
        board.command(code, now)
        now += patience
        assert get(board, "command_word0", now) == (0,), hex(code)
    put(board, "offsets", (0,) * 6, now)
    board.command(0x0700, now)
    now += 0.04
    assert get(board, "full_scale", now)[:6] == (115, 111, 185, 56, 52, 61)
    assert get(board, "offsets", now) == (0,) * 6
    assert get(board, "filter0", STEADY + 21.0)[:6] == pytest.approx(LOAD_COUNTS, abs=4)


# --- reading and writing


def test_access_outside_memory_is_refused() -> None:
    board = board_of()
    for address, count in ((MEMORY_WORDS, 1), (-1, 1), (MEMORY_WORDS - 1, 2)):
        with pytest.raises(RemoteProtocolError):
            board.read(address, count, STEADY)
        with pytest.raises(RemoteProtocolError):
            board.write(address, [0] * count, STEADY)
    assert len(board.read(0, MEMORY_WORDS, STEADY)) == MEMORY_WORDS


def test_board_owned_words_keep_values() -> None:
    board = board_of()
    for name in ("model_no", "units", "filter3", "count2", "default_fs", "software_ver"):
        before = get(board, name, STEADY)
        put(board, name, (77,), STEADY)
        assert get(board, name, STEADY) == before, name
    board.write_word(0x2000, 5, STEADY)
    assert board.read_word(0x2000, STEADY) == 0
    board.write_word(0x1FFF, -5, STEADY)
    assert board.read_word(0x1FFF, STEADY) == 0xFFFB


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.one_of(st.integers(0x60, 0x2FF), st.integers(0, MEMORY_WORDS - 1)),
            st.one_of(
                st.integers(0, 0xFFFF), st.sampled_from([c | a for c in CommandCode for a in (0, 1, 15)])
            ),
            st.floats(0.0, 0.01),
        ),
        max_size=25,
    )
)
def test_arbitrary_host_writes_raise_nothing(writes: list[tuple[int, int, float]]) -> None:
    board, now = board_of(constant(*LOAD)), POWERED + 0.06
    for address, word, wait in writes:
        now += wait
        board.write_word(address, word, now)
        assert all(0 <= word <= 0xFFFF for word in board.read(0, 0x300, now))
        board.command(word, now, address, word)
    assert get(board, "command_word0", now + 0.1)[0] <= 0


def test_live_host_words_act_within_16_samples() -> None:
    board = board_of()
    for k in range(16):
        at = STEADY + k * 0.0101
        put(board, "offsets", (100 + k,), at)
        assert get(board, "offsets", at)[0] == 100 + k
        observed = [get(board, "filter0", at + i / 8000)[0] for i in range(1, 17)]
        assert observed[-1] == -100 - k
        assert set(observed) <= {-100 - k, -99 - k, 0}
        # Before sample number 16 m of the board's own count, whenever the host wrote.
        change = next(i for i, value in enumerate(observed, start=1) if value == -100 - k)
        number = int(np.floor((at + change / 8000) * 8000 + 1e-6)) - int(np.ceil(POWERED * 8000))
        assert number % 16 == 0


def test_clock_words_and_idle_count_advance() -> None:
    board = board_of()
    first, later = board.read(4, 4, STEADY), board.read(4, 4, STEADY + 1 / 8000)
    assert (later[0] - first[0]) % 65536 == 125
    assert board.read(4 * 9, 1, STEADY) == (0,)
    count = get(board, "count_x", STEADY)[0]
    assert (get(board, "count_x", STEADY + 0.1)[0] - count) % 65536 == pytest.approx(5000, abs=10)


def test_counters_advance_at_filter_rates_and_wrap() -> None:
    board = board_of()
    before = [get(board, f"count{n}", STEADY)[0] for n in range(1, 7)]
    after = [get(board, f"count{n}", STEADY + 16.384)[0] for n in range(1, 7)]
    ticks = [(b - a) % 65536 for a, b in zip(before, after, strict=True)]
    assert ticks == [131072 % 65536, 32768, 8192, 2048, 512, 128]


@pytest.mark.sweep
@pytest.mark.parametrize("n", range(7))
def test_sampled_at_is_time_of_new_count(n: int) -> None:
    board, number = board_of(filter_number=n), max(n, 1)
    begin, step = math.ceil(STEADY * 8000), 4 ** (number - 1)
    new: dict[int, float] = {}
    for sample in range(begin, begin + 3 * step):
        count = get(board, f"count{number}", (sample + 0.1) / 8000)[0]
        new.setdefault(count, sample / 8000)
    reported = [board.sampled_at(count) for count in new]
    assert reported[1:] == pytest.approx(list(new.values())[1:], abs=1e-9)
    assert len(new) >= 3
    assert board.sampled_at((count + 1) % 65536) is None, "no reader has seen this count since the reset"


# --- the plug


def test_same_sensor_replugged_is_not_reported_as_changed() -> None:
    board = board_of(loaded_from(STEADY + 1.0))
    now = STEADY + 2.0
    assert get(board, "filter0", now)[:6] == LOAD_COUNTS
    board.unplug(now)
    board.unplug(now)
    assert get(board, "errors", now + 0.009) == (0,)
    assert get(board, "errors", now + 0.01)[0] == Errors.WATCH_DOG
    counts = get(board, "count1", now + 0.01)
    assert get(board, "count1", now + 5.0) == counts
    assert get(board, "filter0", now + 5.0)[:6] == LOAD_COUNTS
    board.plug_in(now + 5.0)
    board.plug_in(now + 5.0)
    assert get(board, "model_no", now + 5.01) == (0,)
    assert get(board, "errors", now + 5.01)[0] == Errors.CALIBRATION_CRC | Errors.SYSTEM_BUSY
    again = now + 5.04
    assert get(board, "errors", again) == (0,)
    assert get(board, "model_no", again) == (1,)
    assert get(board, "offsets", again) == (0,) * 6
    assert get(board, "count1", again)[0] > counts[0]
    do(board, 0x0C00, again)
    assert max(get(board, "maximum", again + 1e-3)) <= max(LOAD_COUNTS) + 2000
    assert get(board, "offsets", again + 3.0) == LOAD_COUNTS


def test_sensor_change_is_reported_until_cleared() -> None:
    board = board_of(loaded_from(STEADY + 1.0))
    now = STEADY + 2.0
    assert get(board, "filter0", now)[:6] == LOAD_COUNTS
    board.unplug(now)
    board.plug_in(now + 5.0, second=True)
    assert get(board, "errors", now + 5.01)[0] == Errors.CALIBRATION_CRC | Errors.SYSTEM_BUSY
    again = now + 5.04
    assert get(board, "errors", again)[0] == Errors.SENSOR_CHANGE
    assert get(board, "serial_no", again) == (1002,)
    assert get(board, "default_fs", again) == (317, 314, 845, 221, 219, 307)
    # The host's full scales continue: the same load gives the same counts, by another calibration.
    assert get(board, "full_scale", again)[:6] == (115, 111, 185, 56, 52, 61)
    assert np.abs(np.subtract(get(board, "filter0", again)[:6], LOAD_COUNTS)).max() <= 3
    assert get(board, "max_full_scale", again)[:3] == (317, 314, 845)
    assert get(board, "errors", again + 1.0)[0] == Errors.SENSOR_CHANGE
    put(board, "errors", (0,), again + 1.0)
    assert get(board, "errors", again + 1.0) == (0,)
    # The second once more is no change, the first is.
    for k, (second, bits) in enumerate(((True, 0), (False, Errors.SENSOR_CHANGE))):
        board.unplug(again + 10 * k + 2.0)
        board.plug_in(again + 10 * k + 3.0, second=second)
        assert get(board, "errors", again + 10 * k + 4.0) == (bits,)
    assert get(board, "serial_no", again + 20.0) == (1001,)


def test_bit_reset_command_clears_sensor_change() -> None:
    board = board_of()
    board.unplug(STEADY)
    board.plug_in(STEADY + 1.0, second=True)
    assert do(board, 0x0400, STEADY + 2.0, 0xF1, 0x0800)[:2] == (0, 0x0800)
    assert get(board, "errors", STEADY + 3.0) == (0,)


def test_data_may_become_zero_without_sensor() -> None:
    board = board_of(loaded_from(STEADY + 1.0), BoardProfile(unplugged_data="zero"))
    board.unplug(STEADY + 2.0)
    assert get(board, "filter2", STEADY + 2.005)[:6] == LOAD_COUNTS
    assert get(board, "filter2", STEADY + 2.1) == (0,) * 8


def test_power_up_without_sensor() -> None:
    board = board_of(sensor=SensorProfile(noise_counts=0.0, connected=False))
    assert get(board, "errors", STEADY)[0] == Errors.WATCH_DOG
    assert get(board, "model_no", STEADY) == (0,)
    board.plug_in(STEADY)
    assert get(board, "errors", STEADY + 0.1) == (0,)
    assert get(board, "model_no", STEADY + 0.1) == (1,)


def test_sensor_replugged_during_boot() -> None:
    board = board_of()
    board.unplug(POWERED + 0.001)
    assert get(board, "errors", POWERED + 0.1)[0] == Errors.WATCH_DOG
    board.reset(POWERED + 1.0)
    board.plug_in(POWERED + 1.001)
    assert get(board, "errors", POWERED + 1.1) == (0,)


def test_sensor_unplugged_during_command_and_before_zero() -> None:
    board = board_of(constant(*LOAD))
    at = POWERED + 1.0
    board.command(0x0A00, at)
    board.unplug(at + 1e-3)
    assert get(board, "errors", at + 2e-3)[0] == Errors.SYSTEM_BUSY
    assert get(board, "command_word0", at + 4e-3) == (0,)
    assert get(board, "errors", at + 4e-3) == (0,)
    assert get(board, "errors", at + 2.0)[0] == Errors.WATCH_DOG
    assert get(board, "offsets", at + 5.0) == (0,) * 6


# --- saturation


def test_saturation_bits_follow_raw_channels() -> None:
    def wrench_at(times: Floats) -> Floats:
        # 1.7 and 2.1 times full scale, a converter ends at twice.
        return np.outer(times >= STEADY + 1.0, [115 * 1.7, -111 * 2.1, 0.0, 0.0, 0.0, 6.1 * 2.1])

    board = board_of(wrench_at)
    assert (get(board, "warnings", STEADY), get(board, "errors", STEADY)) == ((0,), (0,))
    at = STEADY + 1.1
    bits = Warnings.FX_NEAR_SATURATION | Warnings.FY_NEAR_SATURATION | Warnings.MZ_NEAR_SATURATION
    assert get(board, "warnings", at)[0] == bits
    assert get(board, "errors", at)[0] == Errors.FY_SATURATION | Errors.MZ_SATURATION
    put(board, "near_sat_value", (30000,), at)
    put(board, "sat_value", (20000,), at)
    assert get(board, "warnings", at + 0.1)[0] == bits & ~Warnings.FX_NEAR_SATURATION
    assert (
        get(board, "errors", at + 0.1)[0]
        == Errors.FX_SATURATION | Errors.FY_SATURATION | Errors.MZ_SATURATION
    )
    board.unplug(at + 0.2)
    assert get(board, "warnings", at + 0.2) == (0,)


@pytest.mark.parametrize(
    "wrong",
    [
        {"calibration_s": -1.0},
        {"offsets_zeroed_s": 11.0},
        {"command_times": "best"},
        {"units": 4},
        {"unplugged_data": "old"},
        {"turn": "table"},
        {"serial_no": 0},
        {"copyright": "x" * 25},
        {"copyright": "µ"},
        {"adoption_samples": 0},
    ],
)
def test_invalid_profile_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        BoardProfile(**wrong)  # type: ignore[arg-type]


def test_other_invalid_profiles_are_refused() -> None:
    with pytest.raises(ValueError, match=r"full scale of fx is 0\.0259 in units 3"):
        board_of(profile=BoardProfile(units=3))
