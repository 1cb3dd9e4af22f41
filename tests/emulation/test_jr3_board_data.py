"""Tests of the board's computations: filters, transforms, rate, peaks, load envelopes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import ellip, freqz_sos, sosfilt
from scipy.spatial.transform import Rotation

from emulators.devices.jr3.board import Board, BoardProfile
from emulators.devices.jr3.board.filters import ORDER, SECTION_COEFFICIENTS, run_stage
from emulators.devices.jr3.sensor import SensorProfile
from protocol.devices.jr3.board import (
    REGISTERS,
    Link,
    LinkType,
    LoadEnvelope,
    Threshold,
    encode_envelope,
    encode_transform,
    from_signed,
)
from tests.emulation.jr3_board_host import Floats, get, put
from tests.emulation.jr3_board_samples import FULL, POWERED, Wrench, board_of, do

# --- filters

RATES_HZ = {n: 8000 / 4 ** (n - 1) for n in range(1, 7)}
CUTOFFS_HZ = {1: 500.0, 2: 125.04, 3: 31.262, 4: 7.8155, 5: 1.9539, 6: 0.48847}
DELAYS_MS = {
    1: (1.320, 1.863),
    2: (6.598, 8.79),
    3: (27.71, 36.5),
    4: (112.2, 147.0),
    5: (450.0, 590.0),
    6: (1801.0, 2363.0),
}
"""−3 dB frequency and phase delay at 0 Hz and at cut-off, read from the manual's plots."""


def reference(n: int, frequency_hz: float) -> complex:
    """Return the response of filter n: every stage is the same design at its own rate."""
    sections = ellip(6, 0.02, 80, 438.069 / 4000, output="sos")
    response = 1.0 + 0.0j
    for stage in range(1, n + 1):
        _, values = freqz_sos(sections, [0.0, frequency_hz], fs=RATES_HZ[stage])
        response *= values[1] / values[0]
    return response


def measured(
    board: Board, n: int, frequencies_hz: Floats, settle: float, last: float
) -> NDArray[np.complex128]:
    """Return gain and phase of axes fx … mz, each with its own sine, from the words read at the filter's ticks."""
    ticks = np.arange(np.ceil(settle * RATES_HZ[n]), np.floor(last * RATES_HZ[n])) / RATES_HZ[n]
    register = REGISTERS[f"filter{n}"]
    words = np.array([register.values(board.read(register.address, 6, POWERED + t)) for t in ticks])
    result = []
    for axis, frequency in enumerate(frequencies_hz):
        angle = 2 * np.pi * frequency * ticks
        base = np.column_stack([np.sin(angle), np.cos(angle), np.ones(len(ticks))])
        sine, cosine, _ = np.linalg.lstsq(base, words[:, axis].astype(float), rcond=None)[0]
        result.append(complex(sine, cosine) / AMPLITUDE)
    return np.array(result)


AMPLITUDE = 30000.0


def sines(frequencies_hz: Floats) -> Wrench:
    """Return a sine for each axis, in counts from power-up on, of almost twice full scale."""
    amplitudes: Floats = AMPLITUDE / 16384 * FULL

    def wrench_at(times: Floats) -> Floats:
        wrench: Floats = amplitudes * np.sin(2 * np.pi * np.outer(times - POWERED, frequencies_hz))
        return wrench

    return wrench_at


@pytest.mark.sweep
@pytest.mark.parametrize("n", range(1, 7))
def test_filter_response_matches_design_and_manual(n: int) -> None:
    """Pass band within 0.02 dB of the reference design; cut-off and phase delays within 1 % of the manual's."""
    cutoff = CUTOFFS_HZ[n]
    frequencies = np.array([0.03, 0.2, 0.4, 0.6, 0.8, 1.0]) * cutoff
    settle, last = 25 / cutoff, 25 / cutoff + max(34 / cutoff, 0.1)
    board = board_of(sines(frequencies), BoardProfile(offsets_zeroed_s=10.0, boot_s=0.0, calibration_s=0.0))
    if last > 10.0:
        # The board zeroes its offsets once; the words of the host undo it before the filter settles.
        board = board_of(sines(frequencies), BoardProfile(offsets_zeroed_s=0.0))
        get(board, "offsets", POWERED + 0.1)
        put(board, "offsets", (0,) * 6, POWERED + 0.1)
    gains = measured(board, n, frequencies, settle, last)
    designed = np.array([reference(n, f) for f in frequencies])
    assert 20 * np.log10(np.abs(gains / designed)) == pytest.approx(np.zeros(6), abs=0.02)
    assert 20 * np.log10(abs(gains[5])) == pytest.approx(-3.01, abs=0.05)
    delays = -np.unwrap(np.angle(gains)) / (2 * np.pi * frequencies) * 1000
    assert delays[0] == pytest.approx(DELAYS_MS[n][0], rel=0.01)
    assert delays[5] == pytest.approx(DELAYS_MS[n][1], rel=0.01)
    expected = -np.unwrap(np.angle(designed)) / (2 * np.pi * frequencies) * 1000
    assert delays == pytest.approx(expected, rel=0.01)


def test_filter_stage_is_elliptic_design() -> None:
    """Coefficients match SciPy's design, gain 1 at 0 Hz; samples match its recursion, in any blocks."""
    design = ellip(6, 0.02, 80.0, 438.069 / 4000.0, output="sos")
    design[0, :3] /= np.prod(design[:, :3].sum(axis=1) / design[:, 3:].sum(axis=1))
    ours = np.insert(np.array(SECTION_COEFFICIENTS), 3, 1.0, axis=1)
    assert np.allclose(ours, design, rtol=1e-12, atol=0.0)
    signal = np.random.default_rng(5).uniform(-30000.0, 30000.0, (6, 1000))
    expected = sosfilt(design, signal)
    state, parts = np.zeros((6, ORDER)), []
    for part in np.split(signal, [0, 1, 2, 130, 131, 600], axis=1):
        output, state = run_stage(part, state)
        parts.append(output)
    assert np.abs(np.concatenate(parts, axis=1) - expected).max() < 1e-7


def test_filter_attenuates_stop_band() -> None:
    frequencies = np.array([1200.0, 1500.0, 2000.0, 2500.0, 3000.0, 3500.0])
    board = board_of(sines(frequencies))
    words = [get(board, "filter1", POWERED + 0.5 + k / 8000)[:6] for k in range(200)]
    assert np.abs(words).max() <= AMPLITUDE * 10 ** (-79 / 20) + 1


def test_filters_and_vectors_have_own_rates() -> None:
    generator = np.random.default_rng(3)

    def wrench_at(times: Floats) -> Floats:
        wrench: Floats = generator.uniform(-0.5, 0.5, (len(times), 6)) * FULL
        return wrench

    board = board_of(wrench_at, committed_until=lambda now: now + 1.0)
    start = 8000
    reads = [board.read(0x90, 56, POWERED + j / 8000) for j in range(start, start + 4096)]
    words = np.array(reads).reshape(-1, 7, 8)
    for n, (step, vector_step) in enumerate(
        zip((1, 1, 4, 16, 64, 256, 1024), (2, 4, 16, 64, 256, 256, 1024), strict=True)
    ):
        changes = np.flatnonzero(np.any(np.diff(words[:, n, :6], axis=0), axis=1)) + start + 1
        vector_changes = np.flatnonzero(np.any(np.diff(words[:, n, 6:], axis=0), axis=1)) + start + 1
        assert set(changes % step) == {0}, n
        assert set(vector_changes % vector_step) == {0}, n
        if n < 4:
            assert len(changes) > 0.9 * 4096 / step
            assert len(vector_changes) > 0.8 * 4096 / vector_step


# --- transforms


LINKS = st.lists(
    st.one_of(
        st.builds(
            Link,
            st.sampled_from([LinkType.TRANSLATE_X, LinkType.TRANSLATE_Y, LinkType.TRANSLATE_Z]),
            st.integers(-1000, 1000),
        ),
        st.builds(
            Link,
            st.sampled_from([LinkType.ROTATE_X, LinkType.ROTATE_Y, LinkType.ROTATE_Z]),
            st.integers(-32768, 32767),
        ),
        st.builds(Link, st.just(LinkType.NEGATE), st.integers(-1, 1)),
    ),
    min_size=3,
    max_size=3,
)


def transformed(links: list[Link], wrench: Floats, turn: str) -> Floats:
    """Return the wrench in another frame by its pose, from positions and directions instead of link by link."""
    force, moment = wrench[:3], wrench[3:]
    origin, frame, sign = np.zeros(3), Rotation.identity(), 1.0
    for link in links:
        match link.type:
            case LinkType.NEGATE:
                sign = -sign if link.amount else sign
            case LinkType.TRANSLATE_X | LinkType.TRANSLATE_Y | LinkType.TRANSLATE_Z:
                origin = origin + frame.apply(np.eye(3)[link.type - 1] * link.amount * 1e-4)
            case _:
                angle = link.amount / 32768 * np.pi * (-1 if turn == "load" else 1)
                frame = frame * Rotation.from_rotvec(np.eye(3)[link.type - 4] * angle)
    about = moment + np.cross(-origin, force)
    return sign * np.concatenate([frame.inv().apply(force), frame.inv().apply(about)])


@settings(max_examples=25, deadline=None)
@given(
    LINKS,
    st.lists(st.floats(-0.4, 0.4), min_size=6, max_size=6),
    st.sampled_from(["load", "frame"]),
)
def test_transform_of_three_links_gives_wrench_in_new_frame(
    links: list[Link], parts: list[float], turn: str
) -> None:
    wrench = np.array(parts) * FULL
    profile = BoardProfile(turn=turn, offsets_zeroed_s=10.0)  # type: ignore[arg-type]
    board = board_of(lambda times: np.tile(wrench, (len(times), 1)), profile)
    scales = (400, 400, 400, 1200, 1200, 1200)
    at = POWERED + 0.1
    put(board, "full_scale", scales, at)
    put(board, "transform4", encode_transform(links), at)
    at = do(board, 0x0A00, at)
    at = do(board, 0x0504, at)
    counts = np.array(get(board, "filter0", at + 0.01)[:6])
    unit = np.array(scales) * [1, 1, 1, 0.1, 0.1, 0.1] / 16384
    assert counts == pytest.approx(transformed(links, wrench, turn) / unit, abs=1.0)


def test_force_at_lever_arm_has_textbook_moment() -> None:
    """100 N along x at a tool tip 200 mm along z: +20 N·m about y at the sensor, none at the tip."""
    force, arm = np.array([40.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.1])
    wrench = np.concatenate([force, np.cross(arm, force)])
    assert wrench[4] == pytest.approx(4.0)
    board = board_of(lambda times: np.tile(wrench, (len(times), 1)))
    at = POWERED + 0.1
    assert get(board, "filter0", at)[4] == pytest.approx(4.0 / 5.2 * 16384, abs=1)
    put(board, "transform0", encode_transform([Link(LinkType.TRANSLATE_Z, 1000)]), at)
    at = do(board, 0x0500, at)
    fx, _, _, mx, my, mz = get(board, "filter0", at + 0.01)[:6]
    assert (mx, mz) == (0, 0)
    assert abs(my) <= 1
    assert fx == pytest.approx(40 / 115 * 16384, abs=1)


def test_transform_of_offsets_matches_manual_example() -> None:
    """fx 5 and nothing else, then a rotation by 90° about z: fy 5 and nothing else."""
    board = board_of(
        lambda times: np.zeros((len(times), 6)),
        sensor=SensorProfile(full_scales_n=(100.0, 100.0, 100.0), noise_counts=0.0),
    )
    at = POWERED + 0.1
    put(board, "offsets", (5,), at)
    put(board, "transform1", encode_transform([Link(LinkType.ROTATE_Z, 16384)]), at)
    at = do(board, 0x0501, at + 0.01)
    assert get(board, "offsets", at) == (0, 5, 0, 0, 0, 0)
    assert get(board, "transform_num", at) == (1,)


def test_long_transform_continues_in_next_slot() -> None:
    links = [Link(LinkType.TRANSLATE_Z, 100)] * 10
    board = board_of(lambda times: np.tile([10.0, 0, 0, 0, 0, 0], (len(times), 1)))
    at = POWERED + 0.1
    put(board, "transform14", encode_transform(links), at)
    done = do(board, 0x050E, at)
    assert done - at == pytest.approx(2.25e-3 + 10 * 0.75e-3)
    assert get(board, "filter0", done + 0.01)[4] == pytest.approx(-1.0 / 5.2 * 16384, abs=1)
    put(board, "transform15", (1,) * 16, at + 1.0)
    assert get(board, "command_word0", board.command(0x050F, at + 1.0)) == (-1,)
    assert get(board, "transform_num", at + 2.0) == (14,)


def test_transform_changes_min_and_max_full_scale() -> None:
    board = board_of(lambda times: np.zeros((len(times), 6)))
    at = POWERED + 0.1
    put(board, "transform0", encode_transform([Link(LinkType.TRANSLATE_Z, 5000)]), at)
    at = do(board, 0x0500, at)
    # Half a metre: my also takes 0.5 m times the 115 N of fx, mx 0.5 m times the 111 N of fy.
    assert get(board, "min_full_scale", at)[3:] == (56 + 555, 52 + 575, 61)
    assert get(board, "max_full_scale", at)[3:] == (555, 575, 61)


def test_coupled_sensor_is_decoupled() -> None:
    generator = np.random.default_rng(5)
    coupling = np.eye(6) + generator.uniform(-0.1, 0.1, (6, 6))
    wrench = FULL * [0.3, -0.2, 0.1, 0.4, -0.1, 0.2]
    sensor = SensorProfile(noise_counts=0.0, adc_bits=16, coupling=tuple(coupling.ravel()))
    board = board_of(lambda times: np.tile(wrench, (len(times), 1)), sensor=sensor)
    raw = [get(board, f"raw{channel}_data", POWERED + 0.1)[0] for channel in range(1, 7)]
    assert raw == pytest.approx(wrench / FULL * 16384 @ coupling, abs=0.51)
    assert np.array(get(board, "filter0", POWERED + 0.1)[:6]) == pytest.approx(wrench / FULL * 16384, abs=2)


# --- rate, peaks, load envelopes


def ramp(times: Floats) -> Floats:
    """Return a wrench whose fx and −fy grow by 1 count a sample from the board's sample 800 on, up to 8000."""
    counts = np.clip((times - POWERED) * 8000 - 800, 0, 8000)
    return np.outer(counts, [115 / 16384, -111 / 16384, 0, 0, 0, 0])


def at_sample(j: int) -> float:
    return POWERED + j / 8000


def test_rate_is_difference_over_divisor() -> None:
    board = board_of(ramp)
    now = at_sample(1000)
    put(board, "rate_address", (0x90,), now)
    put(board, "rate_divisor", (200,), now)
    put(board, "rate_count", (199,), at_sample(1020))
    # Sample 1021 is the first calculation, and one every 200 samples.
    assert get(board, "rate_count", at_sample(1021)) == (0,)
    assert get(board, "rate_count", at_sample(1121)) == (100,)
    assert get(board, "rate", at_sample(1220))[:2] == (0, 0)
    assert get(board, "rate_count", at_sample(1220)) == (199,)
    assert get(board, "rate", at_sample(1221))[:2] == (200, -200)
    assert get(board, "rate", at_sample(1620))[:2] == (200, -200)
    put(board, "rate_divisor", (0,), at_sample(1620))
    # The new divisor is seen before sample 1632, after one more calculation by the old one.
    assert get(board, "rate", at_sample(1620 + 65536))[:2] == (200, -200)
    assert get(board, "rate", at_sample(1621 + 65536))[0] == 8000 - 821


def test_peaks_are_reported_on_request_and_cleared() -> None:
    board = board_of(ramp)
    assert get(board, "maximum", at_sample(2800)) == (0,) * 8
    at = do(board, 0x0C00, at_sample(2800))
    assert get(board, "maximum", at)[:2] == (2000, 0)
    assert get(board, "minimum", at)[:2] == (0, -2000)
    at = do(board, 0x0B00, at_sample(3000))
    assert get(board, "maximum", at)[:2] == (2200, 0)
    at = do(board, 0x0C00, at_sample(3100))
    assert get(board, "maximum", at)[:2] == (2300, -2201)
    assert get(board, "minimum", at)[:2] == (2201, -2300)
    put(board, "transform0", (0,), at_sample(3200))
    at = do(board, 0x0500, at_sample(3200))
    do(board, 0x0C00, at_sample(3300))
    assert get(board, "minimum", at_sample(3301))[0] > 2400
    put(board, "peak_address", (0xA1,), at_sample(3400))
    do(board, 0x0C00, at_sample(3500))
    low = get(board, "minimum", at_sample(3501))
    assert low[0] == pytest.approx(-2650, abs=3)
    # Eight words from filter2.fy: the last is filter3.fx, which comes later still.
    assert low[7] == pytest.approx(2400, abs=50)


def test_load_envelopes_latch_configured_bits() -> None:
    board = board_of(ramp)
    envelope = LoadEnvelope(
        latch_bits=0x0002,
        at_least=(Threshold(0x90, 1000, 0x0001), Threshold(0x90, 1500, 0x0006)),
        at_most=(Threshold(0x91, -1200, 0x0010), Threshold(0x90, 1100, 0x0028)),
    )
    now = at_sample(900)
    put(board, "load_envelope3", encode_envelope(envelope), now)
    put(board, "load_envelope_num", (3,), now)

    def bits(j: int) -> int:
        return get(board, "threshold_bits", at_sample(j))[0]

    assert bits(1000) == 0x0028
    assert (bits(1799), bits(1800)) == (0x0028, 0x0029)
    # Fourth samples only: 1900 is one, 1901 is not looked at before 1904.
    assert (bits(1900), bits(1903), bits(1904)) == (0x0029, 0x0029, 0x0001)
    assert (bits(1999), bits(2000)) == (0x0001, 0x0011)
    assert bits(2300) == 0x0017
    put(board, "offsets", (5000,), at_sample(2400))
    assert bits(2500) == 0x003A
    board.command(0x0400, at_sample(2500), 0xF2, 0x0002)
    assert bits(2510) == 0x0038
    put(board, "load_envelope_num", (16,), at_sample(2600))
    assert bits(2700) == 0x0038
    put(board, "threshold_bits", (0,), at_sample(2700))
    assert bits(3000) == 0
    put(board, "load_envelope4", (0, -1, -1), at_sample(3000))
    put(board, "load_envelope_num", (4,), at_sample(3000))
    assert bits(3100) == 0


def test_envelopes_and_peaks_accept_any_word() -> None:
    board = board_of(ramp)
    at_least = (
        Threshold(0x05, 2000, 1),
        Threshold(0xE8, 3000, 2),
        Threshold(0x1234, 9, 4),
        Threshold(0xFFFF, 0, 8),
        Threshold(0xC8, 1, 16),
    )
    now = at_sample(900)
    board.write_word(0x1234, 9, now)
    put(board, "rate_address", (0x90,), now)
    put(board, "load_envelope0", encode_envelope(LoadEnvelope(0, at_least)), now)
    assert get(board, "threshold_bits", at_sample(1000))[0] == 4 | 8 | 16
    assert get(board, "threshold_bits", at_sample(2804))[0] == 1 | 4 | 8 | 16
    assert get(board, "threshold_bits", at_sample(3600))[0] == 1 | 2 | 4 | 8 | 16
    put(board, "peak_address", (0xE6,), at_sample(4000))
    do(board, 0x0C00, at_sample(4100))
    count = get(board, "count1", at_sample(4100))[0]
    assert get(board, "maximum", at_sample(4102))[2] == pytest.approx(count, abs=2)


# --- signs


def test_signed_words_wrap() -> None:
    board = board_of(lambda times: np.tile([-11.5, 0, 0, 0, 0, 0], (len(times), 1)))
    assert board.read_word(0x90, POWERED + 0.1) == from_signed(-1638)
