"""Differences between one controller, its program and its RSI context, and the next.

Source: project specification of RSI, sections 2 to 6 and 10; the mark of each setting is that of its row there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from emulators.arm.followed import FollowedProfile
from protocol.arm_size import PerAxis
from protocol.marks import Mark, Preset, above, at_least, between, check_settings, fill_presets, setting

_FASTER_THAN_ANY = 1e6
"""An arm that is not the one to bound the speed: the controller stops it before, by `max_step_mm`."""
_TRANSPORT_DELAYS: Mapping[int, Preset] = {4: Preset(8.0, Mark.ASSUMED), 12: Preset(9.1, Mark.DERIVED)}
"""By the cycle, ms. Derived: of 60.5 ms at 12 ms the loops take 33.3, the next cycle 12, half a step 6."""
_NAMES = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_."


@dataclass(frozen=True, slots=True)
class RsiProfile:
    """An emulated controller, its Ethernet configuration, its signal flow and its arm."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    # --- program
    mode: Literal["relative", "absolute"] = setting(
        "relative", Mark.CHOSEN, "argument of RSI_ON: each value is added, or is the whole correction"
    )
    cycle_ms: Literal[4, 12] = setting(
        4, Mark.OBSERVED, "time between two telegrams: 4 (#IPO_FAST) or 12 (#IPO)", unit="ms"
    )
    move_after_ms: float = setting(
        40.0,
        Mark.ASSUMED,
        "from RSI_ON to RSI_MOVECORR; corrections before are dropped",
        at_least(0.0),
        unit="ms",
    )
    restart_s: float = setting(
        3.0,
        Mark.CHOSEN,
        "after which an operator starts a program again that an error or the stop tag has ended; 0: never",
        at_least(0.0),
        unit="s",
    )
    off_after_ms: float = setting(
        12.0,
        Mark.ASSUMED,
        "from the end of RSI_MOVECORR by the stop tag to RSI_OFF, which comes next in all public programs; 0: never",
        at_least(0.0),
        unit="ms",
    )
    # --- Ethernet object and its configuration
    sentype: str = setting("ImFree", Mark.OBSERVED, "name that answers must carry")
    correction_tag: str = setting(
        "RKorr", Mark.OBSERVED, "element that the signal flow takes for the correction"
    )
    axis_tags: tuple[str, ...] = setting(
        ("AK", "AKorr"),
        Mark.OBSERVED,
        "elements that the signal flow takes for the correction of the axes; of two in an answer the first holds",
    )
    stop_tag: str = setting("Stop", Mark.OBSERVED, "tag whose rising edge ends RSI_MOVECORR")
    send: tuple[str, ...] = setting(
        ("DEF_RIst", "DEF_RSol", "DEF_AIPos", "DEF_ASPos", "DEF_Delay", "ProgStatus.R"),
        Mark.CHOSEN,
        "tags of its telegrams, in order, as its configuration names them",
    )
    rob_type_attr: Literal["Type", "TYPE"] = setting(
        "Type",
        Mark.OBSERVED,
        "spelling in its root: so in KUKA's own client library, in capitals in simulators",
    )
    precision: int = setting(4, Mark.OBSERVED, "decimals of its numbers", between(1, 32))
    onlysend: bool = setting(False, Mark.OBSERVED, "it expects no answers, and takes none")
    timeout: int = setting(
        100, Mark.OBSERVED, "late cycles that it tolerates; the object's own default is 10", at_least(1)
    )
    late_count: Literal["consecutive", "total"] = setting(
        "consecutive", Mark.ASSUMED, "whether a good answer begins the count of the time-out again"
    )
    holdon: Literal["by mode", "keep", "zero"] = setting(
        "by mode", Mark.DERIVED, "channels of a cycle without an answer; by mode: zero if relative, else keep"
    )
    double_reply: Literal["first", "last"] = setting(
        "first", Mark.ASSUMED, "which of two answers in a cycle holds"
    )
    answer_prolog: Literal["discard", "take"] = setting(
        "discard", Mark.ASSUMED, "an answer that begins with an XML declaration; no public client sends one"
    )
    answer_nul: Literal["discard", "take"] = setting(
        "discard", Mark.ASSUMED, "an answer with NUL characters behind its end; no public client sends them"
    )
    empty_first: bool = setting(False, Mark.OBSERVED, "the first telegram is empty, as of RSI 2.3 and older")
    ipoc_start: int = setting(123456, Mark.CHOSEN, "its clock at power-up", between(0, 2**62), unit="ms")
    ipoc_restart: Literal["continue", "anew"] = setting(
        "continue", Mark.ASSUMED, "whether the clock continues when the program is restarted"
    )
    # --- correction
    ref: Literal["base", "tool"] = setting("base", Mark.OBSERVED, "RefCorrSys of POSCORR")
    tool_frame: Literal["start", "current"] = setting(
        "start", Mark.ASSUMED, "orientation of the tool frame that corrections are told in"
    )
    rel_rot: Literal["add", "compose"] = setting("add", Mark.ASSUMED, "how relative turns add up")
    lim_mm: float = setting(
        300.0,
        Mark.CHOSEN,
        "POSCORR: total correction of an axis is clamped there; its own default is 5",
        above(0.0),
        unit="mm",
    )
    lim_deg: float = setting(
        30.0, Mark.CHOSEN, "POSCORR: the same for the turn; its own default is 5", above(0.0), unit="°"
    )
    mon_mm: float = setting(
        600.0,
        Mark.CHOSEN,
        "POSCORRMON: a larger correction ends RSI; its own default is 6",
        above(0.0),
        unit="mm",
    )
    mon_deg: float = setting(
        60.0, Mark.CHOSEN, "POSCORRMON: the same for the turn; its own default is 6", above(0.0), unit="°"
    )
    mon_norm: Literal["euclid", "component"] = setting("euclid", Mark.ASSUMED, "what POSCORRMON measures")
    max_step_mm: float = setting(
        1.0, Mark.ASSUMED, "a correction that changes by more in 4 ms stops the robot", above(0.0), unit="mm"
    )
    max_step_deg: float = setting(0.4, Mark.ASSUMED, "the same for its turn", above(0.0), unit="°")
    lim_axis_deg: PerAxis = setting(
        (90.0,) * 6,
        Mark.OBSERVED,
        "AXISCORR: total correction of each axis is clamped there; its own default is 5",
        above(0.0),
        unit="°",
    )
    axis_ends: Literal["stop", "cut"] = setting(
        "stop",
        Mark.CHOSEN,
        "at the end of an axis's range: the robot stops, or AXISCORR cuts there, as KUKA's own program for its client "
        "library sets it up",
    )
    mon_axis_deg: PerAxis = setting(
        (90.0,) * 6,
        Mark.OBSERVED,
        "AXISCORRMON: a larger correction of an axis ends RSI; its own default is 6",
        above(0.0),
        unit="°",
    )
    # --- arm
    transport_delay_ms: float = setting(
        None,
        Mark.ASSUMED,
        "from a correction to the position loops. By the cycle: 8 at 4 ms; 9.1 at 12 ms, so that RIst follows a set "
        "point after the 60.5 ms of zkoller/IntelRealSense-With-RSI",
        between(0.0, 1000.0),
        unit="ms",
    )
    natural_frequency_rad_s: float = setting(
        60.0, Mark.ASSUMED, "natural frequency of the closed position loop", above(0.0), unit="rad/s"
    )
    damping_ratio: float = setting(1.0, Mark.ASSUMED, "damping of the closed position loop", above(0.0))
    model: Literal["kr16-2"] = setting("kr16-2", Mark.CHOSEN, "the arm")

    @property
    def presets(self) -> Mapping[str, Preset]:
        """Defaults that depend on the cycle."""
        return {"transport_delay_ms": _TRANSPORT_DELAYS[self.cycle_ms]}

    def __post_init__(self) -> None:
        fill_presets(self)
        check_settings(self)
        for tag in (*self.send, self.correction_tag, *self.axis_tags, self.stop_tag):
            if not tag or tag.count(".") > 1 or not set(tag) <= set(_NAMES) or not tag[0].isalpha():
                raise ValueError(
                    f"{tag!r} is no tag: give a name, or two with a dot between, as DEF_RIst or Status.R"
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
        """The arm's motion."""
        return FollowedProfile(
            cycle_ms=self.cycle_ms,
            transport_delay_ms=self.transport_delay_ms,
            natural_frequency_rad_s=self.natural_frequency_rad_s,
            damping_ratio=self.damping_ratio,
            speed_mm_s=_FASTER_THAN_ANY,
            reorientation_deg_s=_FASTER_THAN_ANY,
        )
