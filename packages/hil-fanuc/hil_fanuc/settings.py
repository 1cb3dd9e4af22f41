"""Settings of the client: section `[robot.fanuc]`."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from hil_fanuc.arms import MODELS
from hil_fanuc.rmi import STREAM_PROGRAM
from protocol.marks import Mark, Preset, above, at_least, between, check_settings, fill_presets, setting

ModelName = Literal["crx-10ia/l", "m-10ia"]


@dataclass(frozen=True, slots=True)
class FanucSettings:
    """Settings with which the bridge drives the robot."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    model: ModelName = setting(
        "crx-10ia/l", Mark.CHOSEN, "model of the arm; its kinematics convert set points to joints"
    )
    cycle_ms: float = setting(
        8.0,
        Mark.OBSERVED,
        "sampling period of the controller; a controller with another one is refused",
        above(0.0, 1000.0),
        unit="ms",
    )
    version: Literal[0, 1, 2] = setting(
        0,
        Mark.CHOSEN,
        "version of Stream Motion; 0: 3 or later, as the controller offers it",
    )
    world_height_mm: float = setting(
        None,
        Mark.OBSERVED,
        "height of the controller's world frame, on axis 1 at axis 2, in the base frame of a run; 0: a run uses the "
        "world frame. By the model: above its mounting face",
        unit="mm",
    )
    stream_j3: Literal["upper arm", "horizon"] = setting(
        "upper arm",
        Mark.OBSERVED,
        "reference of J3 in packets: observed in version 3; a client for versions 1 and 2 expects the horizon",
    )
    program: str = setting(STREAM_PROGRAM, Mark.OBSERVED, "TP program that begins the streaming")
    reports: Literal["tcp", "face plate"] = setting(
        "tcp", Mark.CHOSEN, "point that the controller reports on request, and that a run guides"
    )
    start_move: int = setting(
        0, Mark.CHOSEN, "set points that the controller buffers before it moves", between(0, 9)
    )
    limits_percent: float = setting(
        90.0,
        Mark.CHOSEN,
        "share of the controller's limits of speed, acceleration and jerk that set points use",
        above(0.0, 100.0),
        unit="%",
    )
    load_percent: float = setting(
        100.0,
        Mark.CHOSEN,
        "load for which the limits hold, as a share of the largest load",
        between(0.0, 100.0),
        unit="%",
    )
    sensor: Literal["none", "built-in", "external"] = setting(
        "none",
        Mark.CHOSEN,
        "force sensor that the controller reports on request, from version 4 on",
    )
    force_axes: Literal["tool", "base"] = setting(
        "tool", Mark.ASSUMED, "frame of the reported force; no source specifies it"
    )
    answer_s: float = setting(
        1.0,
        Mark.DERIVED,
        "time limit for an answer of the controller at the start; that of the maker's client",
        at_least(0.1),
        unit="s",
    )
    ready_s: float = setting(
        2.0,
        Mark.DERIVED,
        "time limit from the start packet until the controller is ready; that of the maker's client",
        at_least(0.1),
        unit="s",
    )

    @property
    def presets(self) -> Mapping[str, Preset]:
        """Defaults that depend on the model."""
        height = MODELS[self.model].world_height_mm if self.model in MODELS else 0.0
        return {"world_height_mm": Preset(height, Mark.OBSERVED)}

    def __post_init__(self) -> None:
        fill_presets(self)
        check_settings(self)

    @property
    def cycle_s(self) -> float:
        """Sampling period, s."""
        return self.cycle_ms / 1e3
