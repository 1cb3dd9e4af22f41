"""Stability of the sampled force loop, and the limit cycle that the position resolution causes in it.

The loop: every T seconds a controller converts the force error to a position command. The command reaches the servo
after a delay d and stays active until the next command. The servo is of second order with dc gain 1, and the
surface is a spring:

    L(z) = k_e · C(z) · P(z),    closed loop 1 + L(z) = 0,    z = exp(jθ),  θ = ω·T in (0, π].

The plant is exact for a command held over a period. s(t) is the step response of the servo, with s(t < 0) = 0:

    P(z) = Σ_n h_n z⁻ⁿ,    h_n = s(nT − d) − s((n − 1)T − d).

A delay that is not a multiple of T needs no special treatment in this form. The controllers convert the error in N
to the command in m:

    PI in velocity form   C(z) = K_p + K_i · z/(z − 1)
    admittance            C(z) = [T − τ(1 − a) + τ(1 − a)²/(z − a)]/B · z/(z − 1),   τ = M/B, a = exp(−T/τ)

The admittance is the mass M with the damper B, discretised exactly for a force held over a period.
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
"""Transfer function of z."""

_SETTLED = 1e-9
"""Remainder of the step response at which the list of taps ends."""
_GRID = 20_000
"""Number of frequencies at which a loop is evaluated. Crossings between them are interpolated."""
_LOWEST = 1e-4
"""Lowest frequency at which a loop is evaluated, rad per sample. The crossings of an integrating loop are far above
it.
"""

_FEWEST_SAMPLES = 4
"""Minimum number of samples per limit cycle. With fewer, the period depends on the phase of the samples."""
_START_STEPS = 5
"""Number of steps below the border at which the simulation of the holding servo starts, so that the loop approaches
its cycle from outside.
"""
_LEARNED, _COUNTED = 200, 100
"""Number of samples until the loop of the holding servo repeats, and number of samples that are then evaluated."""
_PHASES = 5
"""Offsets of the first sample within a tick of the servo, over which the cycle of the holding servo is averaged."""


@dataclass(frozen=True, slots=True)
class SampledPlant:
    """Position loop as the force controller sees it: period, delay and servo, in SI units."""

    period: float
    """T: time from one command to the next, s."""
    delay: float
    """d: time from the force sample until the servo receives the resulting command, s."""
    natural_frequency: float = 40.0
    """Natural frequency of the closed position loop, rad/s. Assumed: computer-link specification, section 6."""
    damping_ratio: float = 1.0
    """Damping ratio of the closed position loop. Assumed: computer-link specification, section 6."""

    def __post_init__(self) -> None:
        require_above_zero(self, "period", "natural_frequency", "damping_ratio")
        require_not_negative(self, "delay")

    def step_response(self, time: Floats) -> Floats:
        """Return the step response s(t) of the servo: 0 before t = 0, and tending to 1."""
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
        """Return the taps h_0, h_1, …, which are the contributions of a command to the position n samples later.
        Their sum is 1.
        """
        slowest = self.natural_frequency * min(self.damping_ratio, 0.5 / self.damping_ratio)
        settling = self.delay - math.log(_SETTLED) / slowest
        samples = np.arange(-1, math.ceil(settling / self.period) + 2, dtype=np.float64)
        ends: Floats = samples * self.period - self.delay
        taps: Floats = np.diff(self.step_response(ends))
        total = float(taps.sum())
        return taps / total

    def response(self, z: Complexes) -> Complexes:
        """Return the response P(z) of the plant on the unit circle."""
        return np.polyval(self.taps()[::-1], 1.0 / z).astype(np.complex128)


def pi_response(proportional: float, integral: float) -> Response:
    """Return C(z) of the PI controller in velocity form. Gains are in m/N; the integral gain is per sample."""
    return lambda z: proportional + integral * z / (z - 1.0)


def admittance_response(mass: float, damping: float, period: float) -> Response:
    """Return C(z) of a virtual mass (kg) with a damper (N·s/m), updated once per period (s)."""
    tau = mass / damping
    a = math.exp(-period / tau) if tau > 0.0 else 0.0
    coasted = tau * (1.0 - a)
    return lambda z: (period - coasted + coasted * (1.0 - a) / (z - a)) / damping * z / (z - 1.0)


@dataclass(frozen=True, slots=True)
class Margins:
    """Stability margins of a loop."""

    gain_margin: float
    """Gain margin: factor on the gain at which the loop begins to oscillate; inf if it never does. A loop with a
    factor below 1 already oscillates.
    """
    phase_margin_deg: float
    """Phase margin at the frequency where the gain is 1, degrees; inf if the gain is nowhere 1."""
    phase_crossover_rad_s: float
    """Frequency at which the phase is −180° and the loop would oscillate, rad/s, or NaN."""
    gain_crossover_rad_s: float
    """Frequency at which the gain is 1, rad/s, or NaN."""

    @property
    def stable(self) -> bool:
        """Whether both margins are positive. Valid for a controller with one integrator and falling gain."""
        return self.gain_margin > 1.0 and self.phase_margin_deg > 0.0


def loop_response(stiffness: float, controller: Response, plant: SampledPlant, theta: Floats) -> Complexes:
    """Return the loop response L(exp(jθ)) for θ in rad per sample. The stiffness is in N/m."""
    z = np.exp(1j * theta)
    return stiffness * controller(z) * plant.response(z)


def loop_phase_deg(stiffness: float, controller: Response, plant: SampledPlant, omega: Floats) -> Floats:
    """Return the phase of the loop in degrees, unwrapped, at ω in rad/s up to π/T. The phase of an integrating loop
    starts at −90°.
    """
    theta = np.geomspace(_LOWEST, math.pi, _GRID)
    phase = np.unwrap(np.angle(loop_response(stiffness, controller, plant, theta)))
    return np.degrees(np.interp(omega * plant.period, theta, phase))


def margins(stiffness: float, controller: Response, plant: SampledPlant) -> Margins:
    """Return the gain margin and the phase margin of the loop."""
    theta, loop = _sweep(stiffness, controller, plant)
    gain_margin, crossover = math.inf, math.nan
    for where, value in _crossings(theta, loop.imag, loop):
        if value.real < 0.0 and 1.0 / abs(value) < gain_margin:
            gain_margin, crossover = 1.0 / abs(value), where
    # At z = −1 every loop is real, without a change of sign.
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
    """Predicted limit cycle that quantised positions cause."""

    peak_to_peak: float
    """Peak-to-peak force, N."""
    period: float
    """Period, s."""
    levels: int
    """Number of resolution steps between the lowest and the highest position."""


@dataclass(frozen=True, slots=True)
class Quantiser:
    """Quantisation of positions in steps, and the location of the desired force between two steps."""

    resolution: float
    """Δx_res: position resolution, m."""
    dead_band: float = 0.0
    """b: largest error without correction in either direction, in steps."""
    offset: float = 0.5
    """p: location of the desired force between the two nearest reachable forces, as a share (0 … 1) of their
    difference.
    """


def limit_cycle(
    stiffness: float, controller: Response, plant: SampledPlant, quantiser: Quantiser
) -> LimitCycle:
    """Return the limit cycle of a loop whose position moves in resolution steps, by the describing function.

    The desired force lies between two reachable forces, which are k_e·Δx_res apart; `offset` is its position
    between them. So the integrator endlessly moves the command back and forth across the border between two
    positions. Around that border the quantiser is a relay of height q, with i further steps from the amplitude i·q
    on:

        N(A) = 2q/(πA) · [1 + 2·Σ_{i=1}^{⌊A/q⌋} √(1 − (i·q/A)²)]

    and an oscillation persists where N(A)·L(exp(jθ)) = −1. Without a dead band, θ is the phase crossover of the
    loop and N(A) its gain margin. As long as the gain margin exceeds 4/π at A = q, the loop uses only two
    positions, and the force oscillates by k_e·q: the paper's k_e·Δx_res. A dead band of ± b·q about the border
    turns the relay into a relay with hysteresis, N(A) = 2q/(πA)·exp(−j·asin(b·q/A)), whose balance is Im L =
    −π·b/2, at a lower θ.

    Off the centre, the return across the border is slower from one side than from the other. For the same dead
    time, a period P at the centre becomes P/(4·p·(1 − p)) at the offset p. For an integrator with a dead time this
    is exact. The distance that the servo has not followed within half a period is subtracted from the amplitude.

    Raises ValueError for an offset outside (0, 1), or if the loop has no such oscillation.
    """
    resolution, dead_band, offset = quantiser.resolution, quantiser.dead_band, quantiser.offset
    if not 0.0 < offset < 1.0:
        raise ValueError(f"the offset must be between 0 and 1, got {offset}")
    theta, loop = _sweep(stiffness, controller, plant)
    balance = -math.pi * dead_band / 2.0
    places = [(w, v) for w, v in _crossings(theta, loop.imag - balance, loop) if v.real < 0.0]
    if not dead_band and loop[-1].real < 0.0:
        places.append((math.pi, loop[-1]))
    if not places:
        raise ValueError("this loop has no limit cycle: its phase never satisfies the harmonic balance")
    where, value = max(places, key=lambda place: abs(place[1]))
    steps = 1 if dead_band else 2 * _further_steps(1.0 / abs(value)) + 1
    samples = max(math.tau / where, _FEWEST_SAMPLES)
    swing = steps * _followed(plant, round(samples))
    period = samples / (4.0 * offset * (1.0 - offset)) * plant.period
    return LimitCycle(stiffness * resolution * swing, period, steps)


@dataclass(frozen=True, slots=True)
class HoldingServo:
    """Servo that stops once the rounded position equals its set point."""

    resolution: float
    """Δx_res: position resolution, m."""
    tick: float
    """Interval at which the servo reads its newest set point and its position, s."""


def holding_limit_cycle(
    stiffness: float, integral: float, plant: SampledPlant, servo: HoldingServo, smoothing: float = 0.0
) -> LimitCycle:
    """Return the limit cycle with a servo that holds its position once the rounded position equals the set point.

    An integral controller (gain in m/N per sample) acts on the loop that `limit_cycle` describes. The desired force
    is the force at the border between two positions. At every `tick` (s) the servo reads the newest set point and
    its rounded position. If they differ, it moves towards the set point; otherwise it holds its current position.
    So the axis does not move from step to step. It moves across the border, and stops at the next tick. If it
    crosses after m ticks, it has covered the share f_m = s(m·tick) of the distance to its set point. If the samples
    are far enough apart for it to stop, it is held δ beyond the border on both sides:

        2δ = f_m·(q/2 + δ),    δ = q·f_m/(2·(2 − f_m)),    if it had not crossed at m − 1 ticks:
        f_(m−1)·(q/2 + δ) < δ.

    More than one m can satisfy this. The axis also coasts beyond that position, and a force sampled while it coasts
    counts. So there is no formula for the cycle, and it is simulated. The equations of the switched loop, which are
    linear between ticks, are stepped until they repeat, starting some steps below the border. None of their values
    is random or fitted.

    The delay of the plant is the mean delay, including half a tick of waiting for the servo. `smoothing` (s) is the
    time constant of a first-order filter of the force, which the delay must then not include.

    Raises ValueError if the loop is unstable or settles.
    """
    if not margins(stiffness, pi_response(0.0, integral), plant).stable:
        raise ValueError("this loop is unstable, quantised or not")
    resolution, tick = servo.resolution, servo.tick
    loop = _HoldingLoop(stiffness * integral, plant, tick, smoothing)
    runs = [loop.run(plant.period * 10.0 + phase * tick / _PHASES) for phase in range(_PHASES)]
    passages = [np.flatnonzero((run[:-1] < 0.0) & (run[1:] >= 0.0)) for run in runs]
    if min(len(found) for found in passages) < 2:
        raise ValueError("this loop has no limit cycle: it settles")
    peak_to_peak = float(np.mean([np.ptp(run) for run in runs]))
    samples = float(np.mean([(found[-1] - found[0]) / (len(found) - 1) for found in passages]))
    return LimitCycle(stiffness * resolution * peak_to_peak, samples * plant.period, 1)


class _HoldingLoop:
    """Switched loop of `holding_limit_cycle`. Positions are in steps from the border, times in s."""

    def __init__(self, loop_gain: float, plant: SampledPlant, tick: float, smoothing: float) -> None:
        w, zeta = plant.natural_frequency, plant.damping_ratio
        pole = 1.0 / smoothing if smoothing else 0.0
        # State: position, velocity and filtered position, both positions relative to the current set point.
        self._rates = np.array([[0.0, 1.0, 0.0], [-w * w, -2.0 * zeta * w, 0.0], [pole, 0.0, -pole]])
        self._output = 2 if smoothing else 0
        self._over_a_tick = exponential(self._rates * tick)
        self._gain = loop_gain
        self._period = plant.period
        self._dead_time = plant.delay - tick / 2.0
        self._tick = tick

    def run(self, first: float) -> Floats:
        """Return the positions at the evaluated samples. The first sample is at time `first`."""
        pulling = float(-_START_STEPS) + 0.5
        state = np.zeros(3)
        set_point, reported, command = pulling, pulling, pulling
        underway: deque[tuple[float, float]] = deque()
        outputs, ticks = [], 0
        for sample in range(_LEARNED + _COUNTED):
            now = first + sample * self._period
            while (ticks + 1) * self._tick <= now:
                ticks += 1
                state = self._over_a_tick @ state
                before = set_point
                while underway and underway[0][0] <= ticks * self._tick:
                    set_point = underway.popleft()[1]
                position = pulling + float(state[0])
                is_holding = before == set_point == reported
                reported = math.floor(position) + 0.5
                place = set_point if reported != set_point else pulling if is_holding else position
                state[[0, 2]] += pulling - place
                pulling = place
            output = exponential(self._rates * (now - ticks * self._tick)) @ state
            outputs.append(pulling + float(output[self._output]))
            command -= self._gain * outputs[-1]
            underway.append((now + self._dead_time, math.floor(command) + 0.5))
        return np.array(outputs[-_COUNTED:])


def _sweep(stiffness: float, controller: Response, plant: SampledPlant) -> tuple[Floats, Complexes]:
    theta = np.concatenate(
        (np.geomspace(_LOWEST, 0.1, _GRID // 4, endpoint=False), np.linspace(0.1, math.pi, _GRID))
    )
    return theta, loop_response(stiffness, controller, plant, theta)


def _crossings(theta: Floats, values: Floats, loop: Complexes) -> list[tuple[float, complex]]:
    """Return the points at which `values` change sign: θ and the loop response there, both interpolated linearly."""
    # At θ = π, the sign of the imaginary part is only a rounding error.
    before = np.flatnonzero(np.sign(values[:-2]) * np.sign(values[1:-1]) < 0)
    share = values[before] / (values[before] - values[before + 1])
    where = theta[before] + share * (theta[before + 1] - theta[before])
    at = loop[before] + share * (loop[before + 1] - loop[before])
    return list(zip(where.tolist(), at.tolist(), strict=True))


def _quantiser_gain(amplitude: float) -> float:
    """Return N(A) as defined in the docstring of `limit_cycle`, with q = 1."""
    further = np.arange(1, math.floor(amplitude) + 1) / amplitude
    return 2.0 / (math.pi * amplitude) * (1.0 + 2.0 * float(np.sum(np.sqrt(1.0 - further**2))))


def _further_steps(gain: float) -> int:
    """Return ⌊A/q⌋ for the smallest amplitude at which the gain of the quantiser falls to the given value."""
    for steps in range(1, 50):
        if _quantiser_gain(steps * (1.0 - 1e-9)) <= gain:
            return steps - 1
    raise ValueError("this loop is unstable, quantised or not")


def _followed(plant: SampledPlant, samples: int) -> float:
    """Return the share of a square wave that the servo follows. The period of the wave is in samples."""
    high = samples // 2
    square = np.where(np.arange(samples) < high, 1.0, 0.0)
    taps = plant.taps()
    folded = np.zeros(samples)
    np.add.at(folded, np.arange(len(taps)) % samples, taps)
    answer = np.real(np.fft.ifft(np.fft.fft(square) * np.fft.fft(folded)))
    return float(np.ptp(answer))
