"""Stability of the sampled force loop, and the limit cycle that the position resolution leaves in it.

The loop. Every T seconds a controller turns the force error into a position command. The command reaches the servo a
delay d later and stays until the next one. The servo is of second order with dc gain 1, the surface a spring:

    L(z) = k_e · C(z) · P(z),    closed loop 1 + L(z) = 0,    z = exp(jθ),  θ = ω·T in (0, π].

The plant, exact for a command held over a period, with s(t) the servo's step response and s(t < 0) = 0:

    P(z) = Σ_n h_n z⁻ⁿ,    h_n = s(nT − d) − s((n − 1)T − d).

A delay that is no multiple of T needs nothing special in this form. Controllers, error in N to command in m:

    PI in velocity form   C(z) = K_p + K_i · z/(z − 1)
    admittance            C(z) = [T − τ(1 − a) + τ(1 − a)²/(z − a)]/B · z/(z − 1),   τ = M/B, a = exp(−T/τ)

The admittance is the mass M with the damper B, exact for a force held over a period.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.control.checks import require_above_zero, require_not_negative
from hil_bridge.control.exponential import exponential

Floats: TypeAlias = NDArray[np.float64]
Complexes: TypeAlias = NDArray[np.complex128]
Response: TypeAlias = Callable[[Complexes], Complexes]
"""A transfer function of z."""

_SETTLED = 1e-9
"""Rest of the step response that is left out of the taps."""
_GRID = 20_000
"""Frequencies at which a loop is looked at; crossings between them are interpolated."""
_LOWEST = 1e-4
"""Lowest of them, rad per sample: an integrating loop has its crossings far above."""

_FEWEST_SAMPLES = 4
"""Samples of the fastest limit cycle whose period does not depend on where in it the samples fall."""
_START_STEPS = 5
"""Steps below the border at which the holding servo's loop is started: it is to find its cycle from outside."""
_LEARNED, _LOOKED_AT = 200, 100
"""Samples until that loop repeats itself, and those that then count."""
_PHASES = 5
"""Places of the first sample in a tick of the servo, over which that cycle is averaged."""


@dataclass(frozen=True, slots=True)
class SampledPlant:
    """The position loop as the force controller sees it: period, delay and servo. SI units."""

    period: float
    """T, s: from one command to the next."""
    delay: float
    """d, s: from the force sample to the moment when the servo takes the command that it led to."""
    natural_frequency: float = 40.0
    """Natural frequency of the closed position loop, rad/s. Assumed: computer-link specification, section 6."""
    damping_ratio: float = 1.0
    """Damping ratio of the closed position loop. Assumed, likewise."""

    def __post_init__(self) -> None:
        require_above_zero(self, "period", "natural_frequency", "damping_ratio")
        require_not_negative(self, "delay")

    def step_response(self, time: Floats) -> Floats:
        """s(t) of the servo: 0 before 0, towards 1."""
        w, zeta = self.natural_frequency, self.damping_ratio
        t = np.maximum(time, 0.0)
        split = w * math.sqrt(abs(1.0 - zeta * zeta))
        if split < 1e-9 * w:
            rest = (1.0 + w * t) * np.exp(-w * t)
        elif zeta < 1.0:
            rest = np.exp(-zeta * w * t) * (np.cos(split * t) + zeta * w / split * np.sin(split * t))
        else:
            slow, fast = zeta * w - split, zeta * w + split
            rest = (fast * np.exp(-slow * t) - slow * np.exp(-fast * t)) / (2.0 * split)
        return 1.0 - rest

    def taps(self) -> Floats:
        """h_0, h_1, …: what a command adds to the position n samples later. They add up to 1."""
        slowest = self.natural_frequency * min(self.damping_ratio, 0.5 / self.damping_ratio)
        settling = self.delay - math.log(_SETTLED) / slowest
        samples = np.arange(-1, math.ceil(settling / self.period) + 2, dtype=np.float64)
        ends: Floats = samples * self.period - self.delay
        taps: Floats = np.diff(self.step_response(ends))
        total = float(taps.sum())
        return taps / total

    def response(self, z: Complexes) -> Complexes:
        """P(z) on the unit circle."""
        return np.polyval(self.taps()[::-1], 1.0 / z).astype(np.complex128)


def pi_response(proportional: float, integral: float) -> Response:
    """C(z) of the PI in velocity form; gains in m/N, the integral one per sample."""
    return lambda z: proportional + integral * z / (z - 1.0)


def admittance_response(mass: float, damping: float, period: float) -> Response:
    """C(z) of a virtual mass (kg) with a damper (N·s/m), stepped once a period (s)."""
    tau = mass / damping
    a = math.exp(-period / tau) if tau > 0.0 else 0.0
    coasted = tau * (1.0 - a)
    return lambda z: (period - coasted + coasted * (1.0 - a) / (z - a)) / damping * z / (z - 1.0)


@dataclass(frozen=True, slots=True)
class Margins:
    """How far a loop is from instability."""

    gain_margin: float
    """Factor on the gain at which it begins to oscillate; below 1 it already does. inf when none does."""
    phase_margin_deg: float
    """Phase that is left where the gain is 1; inf when it is nowhere 1."""
    phase_crossover_rad_s: float
    """Where the phase is −180°: the frequency at which it would oscillate; NaN when nowhere."""
    gain_crossover_rad_s: float
    """Where the gain is 1; NaN when nowhere."""

    @property
    def stable(self) -> bool:
        """Whether both margins are there, for a controller that integrates once, with falling gain."""
        return self.gain_margin > 1.0 and self.phase_margin_deg > 0.0


def loop_response(stiffness: float, controller: Response, plant: SampledPlant, theta: Floats) -> Complexes:
    """L(exp(jθ)) for θ in rad per sample; stiffness in N/m."""
    z = np.exp(1j * theta)
    return stiffness * controller(z) * plant.response(z)


def loop_phase_deg(stiffness: float, controller: Response, plant: SampledPlant, omega: Floats) -> Floats:
    """Phase of the loop at ω in rad/s, up to π/T, without jumps, °; −90° at first where it integrates."""
    theta = np.geomspace(_LOWEST, math.pi, _GRID)
    phase = np.unwrap(np.angle(loop_response(stiffness, controller, plant, theta)))
    return np.degrees(np.interp(omega * plant.period, theta, phase))


def margins(stiffness: float, controller: Response, plant: SampledPlant) -> Margins:
    """Gain and phase margin of the loop."""
    theta, loop = _sweep(stiffness, controller, plant)
    gain_margin, crossover = math.inf, math.nan
    for where, value in _crossings(theta, loop.imag, loop):
        if value.real < 0.0 and 1.0 / abs(value) < gain_margin:
            gain_margin, crossover = 1.0 / abs(value), where
    # z = −1 is on the real axis whatever the loop, and no change of sign shows it.
    if loop[-1].real < 0.0 and 1.0 / abs(loop[-1]) < gain_margin:
        gain_margin, crossover = 1.0 / abs(loop[-1]), math.pi
    phase_margin, unity = math.inf, math.nan
    for where, value in _crossings(theta, np.log(np.abs(loop)), loop):
        left = math.degrees(math.remainder(math.pi + math.atan2(value.imag, value.real), math.tau))
        if left < phase_margin:
            phase_margin, unity = left, where
    return Margins(gain_margin, phase_margin, crossover / plant.period, unity / plant.period)


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """Prediction for the oscillation that quantised positions leave."""

    peak_to_peak: float
    """Force, N."""
    period: float
    """s"""
    levels: int
    """Resolution steps between the lowest and the highest position taken."""


@dataclass(frozen=True, slots=True)
class Quantiser:
    """Positions in whole steps, and where the desired force lies between two of them."""

    resolution: float
    """Δx_res, m"""
    dead_band: float = 0.0
    """b: largest error without correction, either way, in steps."""
    offset: float = 0.5
    """p: place of the desired force between two that can be reached, 0 … 1 of their distance."""


def limit_cycle(
    stiffness: float, controller: Response, plant: SampledPlant, quantiser: Quantiser
) -> LimitCycle:
    """Limit cycle of the loop whose position moves in whole steps: describing function.

    The desired force lies between two reachable ones, at the offset of their distance k_e·Δx_res. So the
    integrator swings the command over the border between two positions, for ever. Around that border the quantiser is a
    relay of height q, with i further steps from the amplitude i·q on:

        N(A) = 2q/(πA) · [1 + 2·Σ_{i=1}^{⌊A/q⌋} √(1 − (i·q/A)²)]

    and an oscillation persists where N(A)·L(exp(jθ)) = −1. Without a dead band θ is the loop's phase crossover and N(A)
    its gain margin. As long as that exceeds 4/π at A = q, two positions alone take part and the force swings by k_e·q:
    the paper's k_e·Δx_res. A dead band of ± b·q about the border makes the relay one with hysteresis, N(A) =
    2q/(πA)·exp(−j·asin(b·q/A)), whose balance is Im L = −π·b/2, at a lower θ.

    Off the middle the way back over the border is slower from one side than from the other. With the same dead time, a
    period at the middle of P becomes P/(4·p·(1 − p)) at the offset p. For an integrator with a dead time this is exact.
    The way that the servo has not followed within half a period is taken off the swing.

    Raises ValueError for an offset outside (0, 1), or when the loop has no such oscillation.
    """
    resolution, dead_band, offset = quantiser.resolution, quantiser.dead_band, quantiser.offset
    if not 0.0 < offset < 1.0:
        raise ValueError(f"the offset must be between 0 and 1, got {offset}")
    theta, loop = _sweep(stiffness, controller, plant)
    wanted = -math.pi * dead_band / 2.0
    places = [(w, v) for w, v in _crossings(theta, loop.imag - wanted, loop) if v.real < 0.0]
    if not dead_band and loop[-1].real < 0.0:
        places.append((math.pi, loop[-1]))
    if not places:
        raise ValueError("this loop has no limit cycle: its phase nowhere reaches what the balance asks for")
    where, value = max(places, key=lambda place: abs(place[1]))
    steps = 1 if dead_band else 2 * _further_steps(1.0 / abs(value)) + 1
    samples = max(math.tau / where, _FEWEST_SAMPLES)
    swing = steps * _followed(plant, round(samples))
    period = samples / (4.0 * offset * (1.0 - offset)) * plant.period
    return LimitCycle(stiffness * resolution * swing, period, steps)


@dataclass(frozen=True, slots=True)
class HoldingServo:
    """A servo that holds where it is once the rounded position equals its set point."""

    resolution: float
    """Δx_res, m"""
    tick: float
    """Time after which it takes the newest set point and looks at its position, s."""


def holding_limit_cycle(
    stiffness: float, integral: float, plant: SampledPlant, servo: HoldingServo, smoothing: float = 0.0
) -> LimitCycle:
    """Limit cycle with a servo that holds where it is once the rounded position equals its set point.

    An integral controller (gain in m/N a sample) works on the same loop as in `limit_cycle`. The desired force is the
    one on the border between two positions. Every `tick` (s) the servo takes the newest set point and looks at its
    rounded position. If they differ, the set point pulls, else the place where the axis is at that moment. So the axis
    goes not from step to step, but over the border between them and no farther than it is at the next tick. When m
    ticks bring it over, it goes the share f_m = s(m·tick) of the way to its set point. With samples enough to come to
    rest it is held δ beyond the border on both sides:

        2δ = f_m·(q/2 + δ),    δ = q·f_m/(2·(2 − f_m)),    if it was short of the border at m − 1 ticks:
        f_(m−1)·(q/2 + δ) < δ.

    More than one m can fulfil that. The axis also coasts beyond that place, and a force that is sampled meanwhile
    counts. So the cycle has no formula: it is found. The equations of the switched loop,
    linear between ticks, are stepped until they repeat, from some steps below the border, as a controller arrives
    there. Nothing in them is random or fitted.

    The plant's delay is the mean one, half a tick of waiting for the servo included. `smoothing` (s) is the
    time constant of a first-order filter of the force, which the delay must then leave out.

    Raises ValueError when the loop is unstable, or comes to rest.
    """
    if not margins(stiffness, pi_response(0.0, integral), plant).stable:
        raise ValueError("this loop is unstable, quantised or not")
    resolution, tick = servo.resolution, servo.tick
    loop = _HoldingLoop(stiffness * integral, plant, tick, smoothing)
    runs = [loop.run(plant.period * 10.0 + phase * tick / _PHASES) for phase in range(_PHASES)]
    passages = [np.flatnonzero((run[:-1] < 0.0) & (run[1:] >= 0.0)) for run in runs]
    if min(len(found) for found in passages) < 2:
        raise ValueError("this loop has no limit cycle: it comes to rest")
    swing = float(np.mean([np.ptp(run) for run in runs]))
    samples = float(np.mean([(found[-1] - found[0]) / (len(found) - 1) for found in passages]))
    return LimitCycle(stiffness * resolution * swing, samples * plant.period, 1)


class _HoldingLoop:
    """The switched loop of `holding_limit_cycle`; positions in steps from the border, s."""

    def __init__(self, loop_gain: float, plant: SampledPlant, tick: float, smoothing: float) -> None:
        w, zeta = plant.natural_frequency, plant.damping_ratio
        pole = 1.0 / smoothing if smoothing else 0.0
        # State: position and filtered position, both less the place that pulls, and between them the velocity.
        self._rates = np.array([[0.0, 1.0, 0.0], [-w * w, -2.0 * zeta * w, 0.0], [pole, 0.0, -pole]])
        self._output = 2 if smoothing else 0
        self._over_a_tick = exponential(self._rates * tick)
        self._gain = loop_gain
        self._period = plant.period
        self._dead_time = plant.delay - tick / 2.0
        self._tick = tick

    def run(self, first: float) -> Floats:
        """Positions that the samples from time `first` on see, those that count."""
        pulling = float(-_START_STEPS) + 0.5
        state = np.zeros(3)
        taken, reported, wanted = pulling, pulling, pulling
        underway: deque[tuple[float, float]] = deque()
        seen, ticks = [], 0
        for sample in range(_LEARNED + _LOOKED_AT):
            now = first + sample * self._period
            while (ticks + 1) * self._tick <= now:
                ticks += 1
                state = self._over_a_tick @ state
                before = taken
                while underway and underway[0][0] <= ticks * self._tick:
                    taken = underway.popleft()[1]
                position = pulling + float(state[0])
                held = before == taken == reported
                reported = math.floor(position) + 0.5
                place = taken if reported != taken else pulling if held else position
                state[[0, 2]] += pulling - place
                pulling = place
            output = exponential(self._rates * (now - ticks * self._tick)) @ state
            seen.append(pulling + float(output[self._output]))
            wanted -= self._gain * seen[-1]
            underway.append((now + self._dead_time, math.floor(wanted) + 0.5))
        return np.array(seen[-_LOOKED_AT:])


def _sweep(stiffness: float, controller: Response, plant: SampledPlant) -> tuple[Floats, Complexes]:
    theta = np.concatenate(
        (np.geomspace(_LOWEST, 0.1, _GRID // 4, endpoint=False), np.linspace(0.1, math.pi, _GRID))
    )
    return theta, loop_response(stiffness, controller, plant, theta)


def _crossings(theta: Floats, values: Floats, loop: Complexes) -> list[tuple[float, complex]]:
    """Places at which `values` change their sign: θ, and the loop there, by straight lines between neighbours."""
    # At θ = π rounding alone decides the sign of the imaginary part.
    before = np.flatnonzero(np.sign(values[:-2]) * np.sign(values[1:-1]) < 0)
    share = values[before] / (values[before] - values[before + 1])
    where = theta[before] + share * (theta[before + 1] - theta[before])
    at = loop[before] + share * (loop[before + 1] - loop[before])
    return list(zip(where.tolist(), at.tolist(), strict=True))


def _quantiser_gain(amplitude: float) -> float:
    """N(A) of the docstring of `limit_cycle`, with q = 1."""
    further = np.arange(1, math.floor(amplitude) + 1) / amplitude
    return 2.0 / (math.pi * amplitude) * (1.0 + 2.0 * float(np.sum(np.sqrt(1.0 - further**2))))


def _further_steps(gain: float) -> int:
    """⌊A/q⌋ of the smallest amplitude at which the quantiser's gain falls to this one."""
    for whole in range(1, 50):
        if _quantiser_gain(whole * (1.0 - 1e-9)) <= gain:
            return whole - 1
    raise ValueError("this loop is unstable, quantised or not")


def _followed(plant: SampledPlant, samples: int) -> float:
    """Share of a swing that the servo follows of a square wave with this period, in samples."""
    high = samples // 2
    square = np.where(np.arange(samples) < high, 1.0, 0.0)
    taps = plant.taps()
    folded = np.zeros(samples)
    np.add.at(folded, np.arange(len(taps)) % samples, taps)
    answer = np.real(np.fft.ifft(np.fft.fft(square) * np.fft.fft(folded)))
    return float(np.ptp(answer))
