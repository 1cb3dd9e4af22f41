"""Settings of the emulated controller: section `[cell.fanuc]`.

Observed values are those of a CRX-10iA/L with V9.40P/82 (airo-ugent/airo-fanuc, docs/controller-notes.md).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from hil_fanuc.arms import MODELS
from hil_fanuc.settings import ModelName
from protocol.arm_size import PerAxis
from protocol.marks import Mark, Preset, above, at_least, between, check_settings, fill_presets, setting


@dataclass(frozen=True, slots=True)
class FanucProfile:
    """Settings of an emulated controller and its arm."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    model: ModelName = setting("crx-10ia/l", Mark.CHOSEN, "model of the arm")
    # --- Stream Motion
    version: Literal[1, 2, 3, 4] = setting(3, Mark.OBSERVED, "newest version of Stream Motion that it offers")
    cycle_ms: int = setting(8, Mark.OBSERVED, "sampling period", between(1, 100), unit="ms")
    refusals: Literal["smooth", "alarm"] = setting(
        "smooth",
        Mark.CHOSEN,
        "reaction to set points beyond its limits, and to missing ones: smooth as from V9.40P/77 (V10.10P/26) on, or "
        "alarm as before",
    )
    ready_after_ms: float = setting(
        200.0, Mark.ASSUMED, "time from the start packet until it is ready", at_least(0.0), unit="ms"
    )
    recall_ms: float = setting(
        1000.0,
        Mark.OBSERVED,
        "time for which it is not ready after a further call of the TP program",
        at_least(0.0),
        unit="ms",
    )
    stream_j3: Literal["upper arm", "horizon"] = setting(
        "upper arm",
        Mark.OBSERVED,
        "reference of J3 in packets; a client for versions 1 and 2 expects the horizon",
    )
    wrong_numbers: Literal["ignored", "alarm"] = setting(
        "ignored",
        Mark.ASSUMED,
        "reaction to a command whose number answers no report, or one that was answered; ROBOGUIDE raises MOTN-601",
    )
    brake_control: bool = setting(
        False, Mark.OBSERVED, "the brake control was not disabled: the TP program stops with MOTN-615"
    )
    status_check_s: float = setting(
        0.0,
        Mark.CHOSEN,
        "Auto Status Check: time of uninterrupted motion after which it stops with SYST-322; 0: disabled",
        at_least(0.0),
        unit="s",
    )
    packet_stack: int = setting(
        10,
        Mark.ASSUMED,
        "$STMO.$PKT_STACK: set points that it buffers; with alarm, it stops after as many missing ones",
        between(1, 100),
    )
    abnormal_deg: float = setting(
        30.0,
        Mark.ASSUMED,
        "$THRS_ABNPOS: difference of a joint's set point from the one before that raises MOTN-625",
        above(0.0),
        unit="°",
    )
    in_motion_deg_s: float = setting(
        0.01, Mark.ASSUMED, "speed of a joint from which it reports a motion", above(0.0), unit="°/s"
    )
    # --- limits
    speeds_deg_s: PerAxis = setting(
        None, Mark.OBSERVED, "limits of the joints' speeds, by the model", unit="°/s"
    )
    accelerations_deg_s2: PerAxis = setting(
        None, Mark.DERIVED, "limits of the joints' accelerations, by the model", unit="°/s²"
    )
    jerks_deg_s3: PerAxis = setting(
        None, Mark.DERIVED, "limits of the joints' jerks, by the model", unit="°/s³"
    )
    full_load_percent: float = setting(
        100.0,
        Mark.ASSUMED,
        "limits of acceleration and jerk with the largest load, as a share of those without load",
        above(0.0, 100.0),
        unit="%",
    )
    max_speed_mm_s: int = setting(
        2000, Mark.OBSERVED, "$MAX_SPD: largest speed of the tool", between(1, 20000), unit="mm/s"
    )
    collaborative_mm_s: float = setting(
        None,
        Mark.OBSERVED,
        "largest speed of the tool in collaborative mode; 0: none. By the model: 750 for a CRX",
        at_least(0.0),
        unit="mm/s",
    )
    contact_stop_n: float = setting(
        None,
        Mark.ASSUMED,
        "force on the tool at which the contact stop trips; 0: none. By the model: 150 for a CRX",
        at_least(0.0),
        unit="N",
    )
    contact_jerk: float = setting(
        0.0,
        Mark.ASSUMED,
        "ratio of a smoothed set point's jerk to its limit at which the contact stop trips, as a jerky motion was "
        "observed to trip it; 0: never",
        at_least(0.0),
    )
    # --- silence and stops
    silent_slow_ms: float = setting(
        121.0,
        Mark.OBSERVED,
        "time without a set point until it is not ready, at 15.3 °/s or less",
        above(0.0),
        unit="ms",
    )
    silent_fast_ms: float = setting(
        71.0,
        Mark.OBSERVED,
        "time without a set point until it is not ready, at 49.9 °/s or more",
        above(0.0),
        unit="ms",
    )
    coast_slow_ms: float = setting(
        137.0,
        Mark.DERIVED,
        "time for which it goes on at the last speed, at 15.3 °/s or less: overrun of 2.10°",
        above(0.0),
        unit="ms",
    )
    coast_fast_ms: float = setting(
        93.0,
        Mark.DERIVED,
        "time for which it goes on at the last speed, at 49.9 °/s or more: overrun of 4.63°",
        above(0.0),
        unit="ms",
    )
    stop_ms: float = setting(
        200.0, Mark.ASSUMED, "time in which a stop brakes the arm", at_least(0.0), unit="ms"
    )
    stop_ready_ms: float = setting(
        300.0, Mark.OBSERVED, "time from an emergency stop until it is not ready", at_least(0.0), unit="ms"
    )
    stop_bit_ms: float = setting(
        500.0,
        Mark.OBSERVED,
        "time from an emergency stop until it reports it as such",
        at_least(0.0),
        unit="ms",
    )
    # --- Remote Motion Interface
    rmi_answer_ms: float = setting(
        60.0,
        Mark.DERIVED,
        "time until it answers a line: 15 positions in a second were read",
        at_least(0.0),
        unit="ms",
    )
    rmi_free_s: float = setting(
        2.7, Mark.OBSERVED, "time from FRC_Disconnect until another client is served", at_least(0.0), unit="s"
    )
    rmi_lost_s: float = setting(
        0.2,
        Mark.OBSERVED,
        "time from the end of a connection until another client is served",
        at_least(0.0),
        unit="s",
    )
    rmi_idle_min: float = setting(
        60.0,
        Mark.OBSERVED,
        "$RMI_CFG.$DISCNT_TIM: time without a line until it disconnects; 0: never",
        at_least(0.0),
        unit="min",
    )
    lost_client: Literal["abort", "continue"] = setting(
        "abort", Mark.ASSUMED, "what happens to the TP program when the connection of its client ends"
    )
    # --- arm
    transport_delay_ms: float = setting(
        56.0,
        Mark.DERIVED,
        "delay from a set point to the loops: 84 ms from command to report after rest, less the loops",
        between(0.0, 1000.0),
        unit="ms",
    )
    natural_frequency_rad_s: float = setting(
        80.0, Mark.ASSUMED, "natural frequency of the closed position loops", above(0.0), unit="rad/s"
    )
    damping_ratio: float = setting(
        1.0, Mark.ASSUMED, "damping ratio of the closed position loops", above(0.0)
    )
    # --- force, from version 4 on
    force_axes: Literal["tool", "base"] = setting("tool", Mark.ASSUMED, "frame of the reported force")
    force_offset_n: float = setting(
        2.0, Mark.ASSUMED, "largest offset of the reported force, along each axis", at_least(0.0), unit="N"
    )
    force_noise_n: float = setting(
        0.3, Mark.ASSUMED, "noise of the reported force, root mean square", at_least(0.0), unit="N"
    )

    @property
    def presets(self) -> Mapping[str, Preset]:
        """Defaults that depend on the model."""
        if self.model not in MODELS:
            return {}
        model = MODELS[self.model]
        known = Mark.OBSERVED if model.is_collaborative else Mark.ASSUMED
        return {
            "speeds_deg_s": Preset(model.speeds_deg_s, Mark.OBSERVED),
            "accelerations_deg_s2": Preset(model.accelerations_deg_s2, known),
            "jerks_deg_s3": Preset(model.jerks_deg_s3, known),
            "collaborative_mm_s": Preset(750.0 if model.is_collaborative else 0.0, Mark.OBSERVED),
            "contact_stop_n": Preset(150.0 if model.is_collaborative else 0.0, Mark.ASSUMED),
        }

    def __post_init__(self) -> None:
        fill_presets(self)
        check_settings(self)

    @property
    def cycle_s(self) -> float:
        """Sampling period, s."""
        return self.cycle_ms / 1e3

    @property
    def smooths(self) -> bool:
        """Whether set points beyond the limits are smoothed."""
        return self.refusals == "smooth"
