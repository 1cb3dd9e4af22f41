"""Settings that differ between controllers, their programs and RSI contexts.

Source: project specification of RSI, sections 2 to 6 and 10. Each setting has the mark of its row there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from emulators.arm.followed import FollowedProfile
from protocol.arm_size import PerAxis
from protocol.marks import Mark, Preset, above, at_least, between, check_settings, fill_presets, setting

_FASTER_THAN_ANY = 1e6
"""Speed of the arm, mm/s or degrees/s. It is never the limit, because the controller stops the arm first, by
`max_step_mm`.
"""
_TRANSPORT_DELAYS: Mapping[int, Preset] = {4: Preset(8.0, Mark.ASSUMED), 12: Preset(9.1, Mark.DERIVED)}
"""Transport delay by cycle time, ms. Derived from a total delay of 60.5 ms at 12 ms: the loops take 33.3, the next
cycle 12, and half a step 6.
"""
_NAMES = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_."


@dataclass(frozen=True, slots=True)
class RsiProfile:
    """Settings of an emulated controller, its Ethernet configuration, its signal flow and its arm."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    # --- program
    mode: Literal["relative", "absolute"] = setting(
        "relative",
        Mark.CHOSEN,
        "argument of RSI_ON: each value is an increment (relative), or the total correction",
    )
    cycle_ms: Literal[4, 12] = setting(
        4, Mark.OBSERVED, "time between two telegrams: 4 (#IPO_FAST) or 12 (#IPO)", unit="ms"
    )
    move_after_ms: float = setting(
        40.0,
        Mark.ASSUMED,
        "time from RSI_ON to RSI_MOVECORR; earlier corrections are dropped",
        at_least(0.0),
        unit="ms",
    )
    restart_s: float = setting(
        3.0,
        Mark.CHOSEN,
        "time until an operator restarts a program that ended by an error or the stop tag; 0: never",
        at_least(0.0),
        unit="s",
    )
    off_after_ms: float = setting(
        12.0,
        Mark.ASSUMED,
        "time from the end of RSI_MOVECORR by the stop tag to RSI_OFF, which comes next in all "
        "public programs; 0: never",
        at_least(0.0),
        unit="ms",
    )
    # --- Ethernet object and its configuration
    sentype: str = setting("ImFree", Mark.OBSERVED, "sender name that answers must contain")
    correction_tag: str = setting(
        "RKorr", Mark.OBSERVED, "element that the signal flow uses as the correction"
    )
    axis_tags: tuple[str, ...] = setting(
        ("AK", "AKorr"),
        Mark.OBSERVED,
        "elements that the signal flow uses as the correction of the axes; of two in an answer "
        "the first is used",
    )
    stop_tag: str = setting("Stop", Mark.OBSERVED, "tag whose rising edge ends RSI_MOVECORR")
    send: tuple[str, ...] = setting(
        ("DEF_RIst", "DEF_RSol", "DEF_AIPos", "DEF_ASPos", "DEF_Delay", "ProgStatus.R"),
        Mark.CHOSEN,
        "tags of its telegrams, in order, as named in its configuration",
    )
    rob_type_attr: Literal["Type", "TYPE"] = setting(
        "Type",
        Mark.OBSERVED,
        "spelling of an attribute of the root element: Type in KUKA's own client library, TYPE in simulators",
    )
    precision: int = setting(4, Mark.OBSERVED, "decimals of its numbers", between(1, 32))
    onlysend: bool = setting(False, Mark.OBSERVED, "it expects no answers, and ignores any")
    timeout: int = setting(
        100,
        Mark.OBSERVED,
        "number of late cycles that it tolerates; the object's own default is 10",
        at_least(1),
    )
    late_count: Literal["consecutive", "total"] = setting(
        "consecutive",
        Mark.ASSUMED,
        "late cycles that count: consecutive ones, reset by a valid answer, or all",
    )
    holdon: Literal["by mode", "keep", "zero"] = setting(
        "by mode",
        Mark.DERIVED,
        "channel values in a cycle without an answer; by mode: zero if relative, otherwise keep",
    )
    double_reply: Literal["first", "last"] = setting(
        "first", Mark.ASSUMED, "answer that takes effect if two arrive in one cycle"
    )
    answer_prolog: Literal["discard", "take"] = setting(
        "discard",
        Mark.ASSUMED,
        "reaction to an answer that begins with an XML declaration; no public client sends one",
    )
    answer_nul: Literal["discard", "take"] = setting(
        "discard",
        Mark.ASSUMED,
        "reaction to an answer with NUL characters after its end; no public client sends them",
    )
    empty_first: bool = setting(False, Mark.OBSERVED, "the first telegram is empty, as in RSI 2.3 and older")
    ipoc_start: int = setting(123456, Mark.CHOSEN, "clock at power-up", between(0, 2**62), unit="ms")
    ipoc_restart: Literal["continue", "anew"] = setting(
        "continue", Mark.ASSUMED, "clock after a restart of the program"
    )
    # --- correction
    ref: Literal["base", "tool"] = setting("base", Mark.OBSERVED, "RefCorrSys of POSCORR")
    tool_frame: Literal["start", "current"] = setting(
        "start", Mark.ASSUMED, "orientation of the tool frame in which corrections are given"
    )
    rel_rot: Literal["add", "compose"] = setting("add", Mark.ASSUMED, "composition of relative rotations")
    lim_mm: float = setting(
        300.0,
        Mark.CHOSEN,
        "POSCORR: limit of an axis's total correction, which is clamped to it; its own default is 5",
        above(0.0),
        unit="mm",
    )
    lim_deg: float = setting(
        30.0,
        Mark.CHOSEN,
        "POSCORR: limit of the total rotation, which is clamped to it; its own default is 5",
        above(0.0),
        unit="°",
    )
    mon_mm: float = setting(
        600.0,
        Mark.CHOSEN,
        "POSCORRMON: correction above which RSI ends; its own default is 6",
        above(0.0),
        unit="mm",
    )
    mon_deg: float = setting(
        60.0,
        Mark.CHOSEN,
        "POSCORRMON: a larger rotation ends RSI; its own default is 6",
        above(0.0),
        unit="°",
    )
    mon_norm: Literal["euclid", "component"] = setting(
        "euclid", Mark.ASSUMED, "quantity that POSCORRMON monitors"
    )
    max_step_mm: float = setting(
        1.0,
        Mark.ASSUMED,
        "largest change of a correction in 4 ms; a larger one stops the robot",
        above(0.0),
        unit="mm",
    )
    max_step_deg: float = setting(
        0.4,
        Mark.ASSUMED,
        "largest change of a rotation in 4 ms; a larger one stops the robot",
        above(0.0),
        unit="°",
    )
    lim_axis_deg: PerAxis = setting(
        (90.0,) * 6,
        Mark.OBSERVED,
        "AXISCORR: limit of each axis's total correction, which is clamped to it; its own default is 5",
        above(0.0),
        unit="°",
    )
    axis_ends: Literal["stop", "cut"] = setting(
        "stop",
        Mark.CHOSEN,
        "reaction at the end of an axis's range: the robot stops, or AXISCORR clamps the "
        "correction, as in KUKA's own program for its client library",
    )
    mon_axis_deg: PerAxis = setting(
        (90.0,) * 6,
        Mark.OBSERVED,
        "AXISCORRMON: axis correction above which RSI ends; its own default is 6",
        above(0.0),
        unit="°",
    )
    # --- arm
    transport_delay_ms: float = setting(
        None,
        Mark.ASSUMED,
        "delay from a correction to the position loops. By the cycle: 8 at 4 ms; 9.1 at 12 ms, "
        "so that RIst follows a set point after the 60.5 ms of zkoller/IntelRealSense-With-RSI",
        between(0.0, 1000.0),
        unit="ms",
    )
    natural_frequency_rad_s: float = setting(
        60.0, Mark.ASSUMED, "natural frequency of the closed position loop", above(0.0), unit="rad/s"
    )
    damping_ratio: float = setting(1.0, Mark.ASSUMED, "damping ratio of the closed position loop", above(0.0))
    model: Literal["kr16-2"] = setting("kr16-2", Mark.CHOSEN, "model of the arm")

    @property
    def presets(self) -> Mapping[str, Preset]:
        """Defaults that depend on the cycle time."""
        return {"transport_delay_ms": _TRANSPORT_DELAYS[self.cycle_ms]}

    def __post_init__(self) -> None:
        fill_presets(self)
        check_settings(self)
        for tag in (*self.send, self.correction_tag, *self.axis_tags, self.stop_tag):
            if not tag or tag.count(".") > 1 or not set(tag) <= set(_NAMES) or not tag[0].isalpha():
                raise ValueError(
                    f"{tag!r} is not a valid tag: use a name, or two with a dot between, such as DEF_RIst or Status.R"
                )

    @property
    def period(self) -> float:
        """Time between two telegrams, s."""
        return self.cycle_ms / 1e3

    @property
    def keeps(self) -> bool:
        """Whether a channel keeps its value in a cycle without an answer."""
        return self.holdon == "keep" or (self.holdon == "by mode" and self.mode == "absolute")

    @property
    def arm(self) -> FollowedProfile:
        """Motion of the arm."""
        return FollowedProfile(
            cycle_ms=self.cycle_ms,
            transport_delay_ms=self.transport_delay_ms,
            natural_frequency_rad_s=self.natural_frequency_rad_s,
            damping_ratio=self.damping_ratio,
            speed_mm_s=_FASTER_THAN_ANY,
            reorientation_deg_s=_FASTER_THAN_ANY,
        )
