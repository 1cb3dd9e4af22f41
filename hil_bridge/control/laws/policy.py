"""Policy controller: any function from an observation to an action, supervised like every other control law.

The observation contains only values that the client has decoded. The action holds, for each axis that the policy
controls, a share of the largest move of the set point in one sample.
"""

import hashlib
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray

from hil_bridge.control.laws.thinking import MEASURED, Mind, Thinking, check_thinking, think, thinking_time
from hil_bridge.control.types import SAMPLE_MS, STREAM_SAMPLES_MS, Command, Measurement, Tuning
from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.errors.text_files import open_ordinary, read_up_to
from protocol.marks import SettingError

Observed: TypeAlias = NDArray[np.float32]
Policy: TypeAlias = Callable[[Observed], ArrayLike]
"""Function from an observation, shape `(len(OBSERVED),)`, to an action in −1 … 1 for each axis. It must be pure:
equal observations give equal actions. This makes a replay exact.
"""
Axis: TypeAlias = Literal["along", "across", "turn"]
AXES: tuple[Axis, ...] = ("along", "across", "turn")
"""Axes of an action: the approach direction; the third direction of the work frame, perpendicular to the path; and
the rotation about the third direction, which tilts the tool towards the path.
"""
TURN = AXES[2]
FILE_LIMIT_BYTES = 1 << 28
"""Maximum size of a policy file, bytes. Chosen: equal to the limit of a text file. A policy with a million weights
has 4 MB.
"""
TRIAL_S = 5.0
"""Time limit for a policy's first observation, s. Chosen. A loop in the policy might never end."""


class Quantity(NamedTuple):
    """Quantity in an observation, which is one number of it."""

    name: str
    low: float
    high: float
    meaning: str


_FORCE, _MOMENT, _POSITION, _LEAD, _AGE = 1e4, 1e3, 100.0, 1.0, 10.0
_WRENCH = ("force_x_n", "force_y_n", "force_z_n", "moment_x_nm", "moment_y_nm", "moment_z_nm")
OBSERVED: tuple[Quantity, ...] = (
    Quantity(
        "error_n", -_FORCE, _FORCE, "desired force less the contact force along the approach direction, N"
    ),
    Quantity(
        "force_n", -_FORCE, _FORCE, "contact force along the approach direction, N, positive while pressing"
    ),
    Quantity(
        "change_n", -_FORCE, _FORCE, "change of that force since the previous sample, N; 0 for the first one"
    ),
    *(Quantity(name, -_FORCE, _FORCE, "contact force on the tool, tool frame, N") for name in _WRENCH[:3]),
    *(
        Quantity(name, -_MOMENT, _MOMENT, "contact moment on the tool, tool frame, N·m")
        for name in _WRENCH[3:]
    ),
    *(Quantity(f"{axis}_m", -_POSITION, _POSITION, "reported position, base frame, m") for axis in "xyz"),
    *(Quantity(f"q{axis}", -1.0, 1.0, "reported orientation, tool in base") for axis in "wxyz"),
    Quantity(
        "depth_m",
        -_POSITION,
        _POSITION,
        "reported position along the approach direction, from the start point, m",
    ),
    Quantity("ahead_m", -_LEAD, _LEAD, "commanded depth less the reported one, m"),
    Quantity("travel_m", -_POSITION, _POSITION, "reported position along the path, from the start point, m"),
    Quantity("force_age_s", 0.0, _AGE, "age of the force, s"),
    Quantity("pose_age_s", 0.0, _AGE, "age of the reported pose, s; 0 if unknown"),
    Quantity("dt_s", 0.0, _AGE, "time since the previous sample, s"),
    Quantity("unchanged_s", 0.0, _AGE, "time for which the sensor has reported the same counts, s"),
    Quantity("overdue_s", 0.0, _AGE, "time by which the sensor's next frame is late, s"),
    Quantity("in_contact", 0.0, 1.0, "1 while the tool touches the surface"),
    Quantity("saturated", 0.0, 1.0, "1 while an axis of the sensor is at the end of its range"),
    Quantity("held", 0.0, 1.0, "1 while an operator holds the tool at its position"),
    Quantity("fault", 0.0, 1.0, "1 while a device reports a fault"),
)
"""Numbers of an observation, in order. A number outside its range is clipped to the end of the range."""
LOW: Observed = np.array([one.low for one in OBSERVED], np.float32)
HIGH: Observed = np.array([one.high for one in OBSERVED], np.float32)
_NO_SAMPLE = (0.0,) * 10
THINKING = "thinking_ms"
"""Name of the thinking time in the explanation of a cycle in which a policy decides that has a thinking time."""


def observe(measurement: Measurement, reference: float, before: float | None) -> Observed:
    """Return the observation of a sample, shape `(len(OBSERVED),)`. `reference` is the desired force, `before` the
    force of the previous sample, N.

    A number that is not finite becomes 0.
    """
    force, sample = measurement.force, measurement.sample
    pose_age = unchanged = overdue = held = fault = 0.0
    wrench, place, quaternion = _NO_SAMPLE[:6], _NO_SAMPLE[:3], (1.0, 0.0, 0.0, 0.0)
    age = 0.0
    if sample is not None:
        place, age = sample.position, sample.now - sample.sensor_at
        wrench = sample.wrench if len(sample.wrench) == 6 else wrench
        quaternion = sample.quaternion if len(sample.quaternion) == 4 else quaternion
        pose_age = 0.0 if sample.position_at is None else sample.now - sample.position_at
        unchanged, overdue = sample.unchanged, sample.overdue
        held, fault = float(sample.held), float(bool(sample.fault))
    values = (
        reference - force,
        force,
        0.0 if before is None else force - before,
        *wrench,
        *place,
        *quaternion,
        measurement.position,
        measurement.commanded - measurement.position,
        measurement.travel,
        age,
        pose_age,
        measurement.dt,
        unchanged,
        overdue,
        float(measurement.in_contact),
        float(measurement.saturated),
        held,
        fault,
    )
    numbers = [value if math.isfinite(value) else 0.0 for value in values]
    return np.clip(np.array(numbers, np.float64), LOW, HIGH).astype(np.float32)


class PolicyState(Struct, frozen=True):
    """State of a policy controller."""

    force: float | None = None
    """Force of the previous sample, N; None before the first sample."""
    mind: Mind = Mind()


def _check(controller: "PolicyController | PolicyFile") -> None:
    """Raise SettingError for an invalid setting."""
    for name in ("speed_mm_s", "turn_deg_s", "sample_ms"):
        value = getattr(controller, name)
        if not (math.isfinite(value) and value > 0.0):
            raise SettingError(name, "must be above 0")
    check_thinking(controller.thinking_ms)


def _answer(
    controller: "PolicyController | PolicyFile",
    state: PolicyState,
    measurement: Measurement,
    reference: float,
) -> tuple[PolicyState, Command]:
    """Return the set point after the policy's action. A force or a position that is not a number causes no motion."""
    if not measurement.is_finite:
        return state, Command(measurement.commanded, 0.0)
    now = measurement.time if measurement.sample is None else measurement.sample.now
    mind, took_ms = think(
        state.mind, now, lambda: _decide(controller, observe(measurement, reference, state.force), now)
    )
    axes, action = controller.axes, mind.action or (0.0,) * len(controller.axes)
    farthest = controller.speed_mm_s * 1e-3 * measurement.dt
    within = {axis: min(max(share, -1.0), 1.0) for axis, share in zip(axes, action, strict=True)}
    along, across = (within.get(axis, 0.0) * farthest for axis in AXES[:2])
    turn = within.get(TURN, 0.0) * math.radians(controller.turn_deg_s) * measurement.dt
    numbers = {f"action_{axis}": share for axis, share in zip(axes, action, strict=True)}
    if took_ms is not None and controller.thinking_ms:
        numbers[THINKING] = took_ms
    command = Command(measurement.commanded + along, along, explanation=numbers, across=across, turn=turn)
    return PolicyState(measurement.force, mind), command


def _decide(
    controller: "PolicyController | PolicyFile", observation: Observed, now: float
) -> tuple[tuple[float, ...], float]:
    """Return the policy's action and its thinking time, ms. Raises ValueError if the action is invalid."""
    is_measured = controller.thinking_ms == MEASURED
    began = controller.stopwatch() if is_measured else 0.0
    action = np.asarray(controller.policy(observation), np.float64).reshape(-1)
    takes_ms = (
        (controller.stopwatch() - began) * 1e3
        if is_measured
        else thinking_time(controller.thinking_ms, controller.thinking_seed, now)
    )
    axes = controller.axes
    if action.shape != (len(axes),):
        raise ValueError(f"the policy answers {action.size} numbers, not one for each of {', '.join(axes)}")
    if not np.isfinite(action).all():
        raise ValueError(f"the policy answers {action.tolist()}, which is not all numbers")
    return tuple(action.tolist()), takes_ms


_TUNINGS = tuple(Tuning(cycle_ms, {}) for cycle_ms in STREAM_SAMPLES_MS)


@dataclass(frozen=True)
class PolicyController:
    """Policy that a program passes as an object: `simulate(controller=PolicyController(policy))`."""

    name: ClassVar[str] = "given-policy"
    tunings: ClassVar[tuple[Tuning, ...]] = _TUNINGS

    policy: Policy
    axes: tuple[Axis, ...] = AXES[:1]
    """Axes of the action, in order."""
    speed_mm_s: float = 5.0
    """Speed of the set point for an action of 1, mm/s. Chosen: below the guard's limit for motion into the surface."""
    turn_deg_s: float = 5.0
    """Turning speed of the tool for an action of 1, °/s. Chosen: below the guard's limit, `limits.turn_deg_s`."""
    sample_ms: float = SAMPLE_MS
    """Sample time that the policy was made for, ms; a run sets it to that of the robot's cycle."""
    thinking_ms: Thinking = 0.0
    """Time from an observation until its action takes effect, ms. The robot applies it in the first cycle after that;
    until then the previous action continues.
    """
    thinking_seed: int = 0
    """Seed of the thinking times that are drawn from a range."""
    stopwatch: Callable[[], float] = field(default=time.perf_counter, repr=False, compare=False)
    """Clock that measures the thinking time `"measured"`, s."""

    @property
    def turns(self) -> bool:
        """Return whether the policy turns the tool."""
        return TURN in self.axes

    def __post_init__(self) -> None:
        _check(self)
        if not callable(self.policy):
            raise ConfigError(f"a policy must be callable, got {type(self.policy).__name__}")
        if not self.axes or len(set(self.axes)) < len(self.axes) or not set(self.axes) <= set(AXES):
            raise ConfigError(f"axes must be one or more of {', '.join(AXES)}, each once, got {self.axes!r}")

    def initial(self) -> PolicyState:
        """Return the state before the first sample in contact."""
        return PolicyState()

    def step(
        self, state: PolicyState, measurement: Measurement, reference: float
    ) -> tuple[PolicyState, Command]:
        """Return the command for one sample. Raises ValueError if the policy returns an invalid action."""
        return _answer(self, state, measurement, reference)


@dataclass(frozen=True)
class PolicyFile:
    """Policy in an ONNX file. Its input is one observation, its output an action: 1 to 3 numbers for the axes along,
    across and turn, in this order.

    The file is read once, before the run. It needs the extra `onnx`.
    """

    name: ClassVar[str] = "policy"
    tunings: ClassVar[tuple[Tuning, ...]] = _TUNINGS

    file: str = ""
    """Path of the ONNX file; a relative path is resolved against the folder of the configuration."""
    sha256: str = ""
    """Expected SHA-256 of the file; a file with a different one is refused. Empty accepts any file."""
    speed_mm_s: float = 5.0
    """Speed of the set point for an action of 1, mm/s: the one that the policy was trained with."""
    turn_deg_s: float = 5.0
    """Turning speed of the tool for an action of 1, °/s: the one that the policy was trained with."""
    sample_ms: float = SAMPLE_MS
    """Sample time that the policy was made for, ms; a run sets it to that of the robot's cycle."""
    thinking_ms: float = 0.0
    """Time from an observation until its action takes effect, ms; meanwhile the previous action continues."""
    policy: Policy = field(init=False, repr=False, compare=False)
    axes: tuple[Axis, ...] = field(init=False, repr=False, compare=False)
    thinking_seed: ClassVar[int] = 0

    def __post_init__(self) -> None:
        _check(self)
        if not self.file:
            raise SettingError("file", "must be the path of an ONNX file")
        try:
            with open_ordinary(Path(self.file)) as file:
                content = read_up_to(file, FILE_LIMIT_BYTES + 1)
        except ConfigError as error:
            raise SettingError("file", str(error)) from error
        if len(content) > FILE_LIMIT_BYTES:
            raise SettingError(
                "file", f"{self.file} is longer than {FILE_LIMIT_BYTES} bytes, too long for a policy"
            )
        digest = hashlib.sha256(content).hexdigest()
        if self.sha256 and self.sha256.lower() != digest:
            raise SettingError("sha256", f"is not that of {self.file}, which has {digest}")
        policy, count = _load(content, self.file)
        object.__setattr__(self, "policy", policy)
        object.__setattr__(self, "axes", AXES[:count])

    def __reduce__(self) -> tuple[Any, ...]:
        values = self.file, self.sha256, self.speed_mm_s, self.turn_deg_s, self.sample_ms, self.thinking_ms
        return PolicyFile, values

    @property
    def turns(self) -> bool:
        """Whether the policy turns the tool."""
        return TURN in self.axes

    @property
    def stopwatch(self) -> Callable[[], float]:
        """Clock as that of a `PolicyController`; not used for a thinking time that is a number."""
        return time.perf_counter

    def initial(self) -> PolicyState:
        """Return the state before the first sample in contact."""
        return PolicyState()

    def step(
        self, state: PolicyState, measurement: Measurement, reference: float
    ) -> tuple[PolicyState, Command]:
        """Return the command for one sample. Raises ValueError if the policy returns an invalid action."""
        return _answer(self, state, measurement, reference)


@lru_cache(maxsize=4)
def _load(content: bytes, path: str) -> tuple[Policy, int]:
    """Return the policy from an ONNX file, and the number of axes that it controls. Raises ConfigError or
    SettingError.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise ConfigError(
            f"a policy in a file needs the package onnxruntime; {install_command('onnx')}"
        ) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # sums in a reproducible order
    options.log_severity_level = 4
    trial = onnxruntime.RunOptions()
    trial.log_severity_level = 4
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        (model_input,) = session.get_inputs()
        shape = (1, len(OBSERVED)) if len(model_input.shape) == 2 else (len(OBSERVED),)
        name = model_input.name

        def policy(observation: Observed) -> ArrayLike:
            (answer, *_) = session.run(None, {name: observation.reshape(shape)})
            action: ArrayLike = answer
            return action

        patience = threading.Timer(TRIAL_S, setattr, (trial, "terminate", True))
        patience.start()
        try:
            (first, *_) = session.run(None, {name: np.zeros(shape, np.float32)}, trial)
        finally:
            patience.cancel()
        count = int(np.asarray(first).size)
    except Exception as error:  # the file may contain anything
        text = (str(error).splitlines() or [""])[0]
        if trial.terminate:
            text = f"it did not answer within {TRIAL_S:g} s"
        problem = f"{path} is not an ONNX policy from {len(OBSERVED)} numbers (float32) to an action: {text}"
        raise SettingError("file", problem) from error
    if not 1 <= count <= len(AXES):
        raise SettingError("file", f"{path} answers {count} numbers; an action has 1 to {len(AXES)}")
    return policy, count
