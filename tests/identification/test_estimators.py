"""Estimators, on signals with known parameters."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from hil_bridge.devices.facts import MISSING, RobotFacts
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.lab.identification.blocks import blocks_of, jackknife, mean_of
from hil_bridge.lab.identification.line import line_values
from hil_bridge.lab.identification.motion import motion_values
from hil_bridge.lab.identification.observations import DOWN, Observations, Stream, observe_table
from hil_bridge.lab.identification.stream import stream_values
from hil_bridge.lab.identification.surface import surface_values
from hil_bridge.lab.identification.values import Value, Why

RATE_HZ = 500.0
Floats = np.ndarray[Any, np.dtype[np.float64]]


def by_key(values: Any) -> dict[str, Value]:
    return {value.key: value for value in values}


def coloured(draw: np.random.Generator, count: int, memory: float, size: float) -> Floats:
    """Return stationary noise of a standard deviation with this correlation between samples."""
    white = draw.normal(0.0, size * math.sqrt(1.0 - memory**2), count + 200)
    stationary: Floats = lfilter([1.0], [1.0, -memory], white)[200:]
    return stationary


def test_jackknife_interval_of_coloured_noise_has_coverage() -> None:
    draw = np.random.default_rng(1)
    trials = 300
    covered = sum(
        estimate.low <= 0.0 <= estimate.high
        for estimate in (mean_of(coloured(draw, 2400, 0.8, 1.0)) for _ in range(trials))
    )
    assert 0.90 <= covered / trials <= 0.98


def test_interval_needs_minimum_number_of_blocks() -> None:
    estimate = jackknife(np.array([0, 0, 1, 1]), lambda mask: float(mask.sum()))
    assert math.isnan(estimate.low)


def test_blocks_have_equal_weights() -> None:
    weights = np.array([1.0, 1.0, 1.0, 9.0, 1.0, 1.0, 1.0, 9.0])
    numbers = blocks_of(weights, 2)
    assert [weights[numbers == number].sum() for number in (0, 1)] == [12.0, 12.0]


def stream_of(wrench: Floats, step: float) -> Observations:
    times = np.arange(len(wrench)) / RATE_HZ
    stream = Stream(times, wrench, np.full(6, step), (0.0, float(times[-1])), (), None, DOWN)
    return Observations(None, None, None, stream, RobotFacts())


@pytest.mark.parametrize("cutoff_hz", [0.0, 40.0, 100.0])
def test_noise_and_filter_are_identified_despite_vibration(cutoff_hz: float) -> None:
    draw = np.random.default_rng(2)
    memory = math.exp(-2.0 * math.pi * cutoff_hz / RATE_HZ) if cutoff_hz else 0.0
    times = np.arange(3000) / RATE_HZ
    wrench = np.column_stack([coloured(draw, 3000, memory, 0.02) for _ in range(6)])
    wrench[:, 2] += 0.1 * np.sin(2.0 * math.pi * 12.0 * times)
    values = by_key(stream_values(stream_of(wrench, 1e-6)))
    within = [values[f"sensor.noise.{axis}"].holds(0.02) for axis in ("fx", "fy", "fz", "mx", "my", "mz")]
    assert sum(within) >= 5
    assert np.std(wrench[:, 2]) > 0.07
    if cutoff_hz:
        assert values["sensor.cutoff"].holds(cutoff_hz)
        assert values["sensor.cutoff"].high < 1.5 * cutoff_hz
    else:
        assert values["sensor.cutoff"].why is Why.WHITE


def test_only_step_is_identified_for_small_noise() -> None:
    draw = np.random.default_rng(3)
    level = 0.5 * np.arange(3000) / RATE_HZ
    wrench = np.column_stack([np.round(draw.normal(0.0, 0.05, 3000) + level) * 0.01 for _ in range(6)])
    values = by_key(stream_values(stream_of(wrench, 0.01)))
    assert values["sensor.noise.fx"].why is Why.BELOW_STEP
    assert values["sensor.cutoff"].why is Why.NO_NOISE


def test_filter_below_20_hz_is_not_identified() -> None:
    draw = np.random.default_rng(4)
    memory = math.exp(-2.0 * math.pi * 5.0 / RATE_HZ)
    wrench = np.column_stack([coloured(draw, 3000, memory, 0.02) for _ in range(6)])
    values = by_key(stream_values(stream_of(wrench, 1e-6)))
    assert values["sensor.cutoff"].why is Why.SLOW_FILTER
    assert values["sensor.noise.fx"].why is Why.SLOW_FILTER


def pressed_table(stiffness: float, friction: float, exponent: float = 1.0) -> Table:
    """Return the motion of a tool that descends, presses and slides, with the force of a surface with a slope of 1 to
    20.
    """
    draw = np.random.default_rng(5)
    times = np.arange(0.0, 12.0, 0.01)
    distance = 0.005 * np.clip(times - 4.0, 0.0, None)
    depth = np.interp(times, [0.0, 1.0, 3.0, 4.0], [-0.01, -0.004, 0.0, 0.002])
    depth += np.where(times > 4.0, 0.0004 * np.sin(3.0 * (times - 4.0)), 0.0)
    height = -depth + 0.05 * distance
    press = stiffness * np.clip(depth, 0.0, None) ** exponent
    normal = np.array([-0.05, 0.0, 1.0]) / math.hypot(0.05, 1.0)
    along = np.array([1.0, 0.0, 0.05]) / math.hypot(0.05, 1.0)
    force = np.outer(press, normal) - np.outer(friction * press * (times > 4.0), along)
    force += draw.normal(0.0, 0.02, force.shape) + np.array([0.4, -0.2, 0.3])  # without a zero
    columns = {
        "x": distance,
        "y": np.zeros(len(times)),
        "z": height,
        **{axis: force[:, k] for k, axis in enumerate(("fx", "fy", "fz"))},
        "depth": -height,
        "press": force[:, 2],
    }
    return Table(times, columns)


def test_slope_table_identifies_stiffness_and_friction() -> None:
    values = by_key(surface_values(observe_table(pressed_table(4000.0, 0.25))))
    stiffness, friction = values["surface.stiffness"], values["surface.friction"]
    assert stiffness.holds(4000.0)
    assert stiffness.high - stiffness.low < 800.0
    assert friction.holds(0.25)
    assert friction.high - friction.low < 0.05
    assert values["surface.damping"].why is Why.BEHIND_DELAY


def test_table_without_contact_identifies_no_surface() -> None:
    table = pressed_table(4000.0, 0.25)
    free = Table(table.times, {name: values for name, values in table.columns.items() if name != "press"})
    assert {value.why for value in surface_values(observe_table(free))} == {Why.NO_CONTACT}


def test_table_lag_is_lag_of_positions() -> None:
    times = np.arange(0.0, 20.0, 0.004)

    def course(at: Floats) -> Floats:
        motion: Floats = 0.05 * np.sin(0.9 * at) + 0.01 * np.sin(2.3 * at)
        return motion

    draw = np.random.default_rng(6)
    columns = {"x": course(times - 0.043) + draw.normal(0.0, 2e-5, len(times))}
    columns |= {"order_x": course(times), "order_y": 0.0 * times, "order_z": 0.0 * times}
    columns |= {"y": 0.0 * times, "z": 0.0 * times}
    values = by_key(motion_values(observe_table(Table(times, columns)), None, lambda table: None))
    assert values["robot.lag"].holds(0.043)
    assert values["robot.lag"].high - values["robot.lag"].low < 0.002
    assert values["robot.noise.x"].holds(2e-5)
    assert values["robot.servo"].why is Why.NOT_PLAYED
    assert values["robot.turnaround.move"].why is Why.OF_TABLE


def counted(**packets: float) -> dict[str, Value]:
    names = {name.replace("_", " "): value for name, value in packets.items()}
    observations = Observations(None, None, None, None, RobotFacts(), (), names)
    return by_key(line_values(observations))


def test_loss_interval_is_clopper_pearson() -> None:
    """5 of 100: 1.64 to 11.28 %; 0 of 100: up to 3.62 %. Source: tables of the exact binomial interval."""
    lost = counted(packets=95.0, packets_missing=5.0)["line.robot.lost"]
    assert (lost.value, lost.low, lost.high) == pytest.approx((50.0, 16.43, 112.83), rel=1e-3)
    none = counted(packets=100.0)["line.robot.lost"]
    assert (none.value, none.low, none.high) == pytest.approx((0.0, 0.0, 36.22), rel=1e-3)


@pytest.mark.parametrize(
    ("errors", "description"),
    [((MISSING,), "packets of the robot lost"), (("stale packets",), "cycles of the robot missing")],
)
def test_lossless_link_reports_missing_cycles(errors: tuple[str, ...], description: str) -> None:
    observations = Observations(
        None, None, None, None, RobotFacts(errors=errors), (), {"packets": 95.0, MISSING: 5.0}
    )
    lost = by_key(line_values(observations))["line.robot.lost"]
    assert lost.words == description
    assert lost.value == pytest.approx(50.0)


def test_implausible_counters_are_ignored() -> None:
    assert counted(packets=-5.0)["line.robot.lost"].why is Why.NO_COUNTERS
    assert counted(packets=math.nan)["line.robot.lost"].why is Why.NO_COUNTERS
    assert counted(blocks_received=3.0)["line.robot.lost"].why is Why.NO_COUNTERS
