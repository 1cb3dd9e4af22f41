"""Table of figures: the results by which a run is judged, shared by summary, report, criteria, tuning and pages.

Each figure has one key, which includes its unit, and one description. All code that uses figures reads both from
here.
"""

from collections.abc import Iterable, Mapping

from hil_bridge.record.analysis.definition import UNKNOWN, Definition, Good, Group

_CAMPAIGN, _RESPONSE, _CONTACT, _RUN = Group.CAMPAIGN, Group.RESPONSE, Group.CONTACT, Group.RUN
_TABLE = (
    Definition(
        "outcome",
        "outcome",
        "",
        "completed, stopped, interrupted, refused or error",
        _CAMPAIGN,
        Good.NONE,
        "",
    ),
    Definition(
        "retracted",
        "retracted",
        "",
        "the tool was taken off the surface at the end, or never moved",
        _CAMPAIGN,
        Good.NONE,
        "",
    ),
    Definition(
        "force_true_max_n",
        "largest true force",
        "N",
        "largest true contact force, sampled every 10 ms",
        _CAMPAIGN,
        least=0.1,
    ),
    Definition("force_true_end_n", "true force at the end", "N", "true contact force at the end", _CAMPAIGN),
    Definition(
        "force_bound_n",
        "bound of the true force",
        "N",
        "bound of the true force by the facts of robot and sensor",
        _CAMPAIGN,
        Good.NONE,
    ),
    Definition(
        "force_beyond_n",
        "true force minus its bound",
        "N",
        "largest true force minus that bound and the increase due to faults; omitted if infinite",
        _CAMPAIGN,
    ),
    Definition(
        "promises_broken",
        "promises broken",
        "",
        "promises of the guard that the run did not keep",
        _CAMPAIGN,
        form=".0f",
    ),
    Definition("promises", "broken promises", "", "the same as text", _CAMPAIGN, Good.NONE, ""),
    Definition(
        "duration_s", "duration", "s", "duration of the run on its own clock", _CAMPAIGN, Good.NONE, ".1f"
    ),
    Definition("cycles", "cycles", "", "control cycles", _RUN, Good.NONE, ".0f"),
    Definition("struck", "faults struck", "", "times that faults had an effect", _CAMPAIGN, Good.NONE, ".0f"),
    Definition(
        "faults_struck",
        "struck by",
        "",
        "the same for each fault, by device, target and fault",
        _CAMPAIGN,
        Good.NONE,
        "",
    ),
    Definition(
        "causes",
        "causes",
        "",
        "how often the run reported each row of the table of causes that ended it or followed",
        _CAMPAIGN,
        Good.NONE,
        "",
    ),
    Definition(
        "recovery_s",
        "recovery",
        "s",
        "time from the end of the last fault until the true force stays within 20 % of the target",
        _CAMPAIGN,
    ),
    Definition(
        "steps_failed",
        "steps failed",
        "",
        "steps of a program that did not meet their criterion",
        _CAMPAIGN,
        form=".0f",
    ),
    Definition(
        "rise_samples",
        "rise to 90 %",
        "cycles",
        "first sample at 90 % of the target, from the first tracked one",
        form=".0f",
        least=1.0,
        of_several="first sample at 90 % of the target, slowest stroke",
    ),
    Definition(
        "rise_s",
        "rise time",
        "s",
        "time from the first tracked sample to 90 % of the target",
        least=0.02,
    ),
    Definition(
        "overshoot_percent",
        "overshoot",
        "%",
        "largest force above the target, of the target",
        form=".1f",
        least=1.0,
    ),
    Definition(
        "steady_mean_error_n",
        "steady mean error",
        "N",
        "mean of force minus target, last 40 samples",
        good=Good.NEAR_ZERO,
        form="+.2f",
        least=0.02,
        of_several="mean of force minus target, end of the last stroke",
    ),
    Definition(
        "steady_peak_to_peak_n",
        "steady peak-to-peak",
        "N",
        "spread of force minus target, last 40 samples",
        least=0.1,
        of_several="spread of the last 40 samples of the last stroke",
    ),
    Definition(
        "rms_error_n",
        "RMS error",
        "N",
        "root mean square of force minus target, rise included",
        least=0.02,
    ),
    Definition(
        "contact_losses",
        "contact losses",
        "",
        "times that the tool left the surface while tracking",
        form=".0f",
        least=1.0,
        of_several="times that the tool left the surface in a stroke",
    ),
    Definition(
        "steps_per_s",
        "steps moved",
        "1/s",
        "resolution steps of the command in steady state: wear",
        least=0.5,
    ),
    Definition(
        "largest_force_n",
        "largest force",
        "N",
        "largest measured force at any time while tracking",
        form=".1f",
        least=0.1,
    ),
    Definition(
        "touch_speed_mm_s",
        "speed of the touch",
        "mm/s",
        "reported speed along the approach in the last 0.1 s before the first force above 1 N",
        _RESPONSE,
        Good.NONE,
    ),
    Definition(
        "touch_peak_n",
        "peak of the touch",
        "N",
        "largest force in the 3 s after the touch",
        _RESPONSE,
        form=".1f",
        least=0.1,
    ),
    Definition(
        "touch_impulse_ns",
        "impulse of the touch",
        "N·s",
        "integral of the force above the target over these 3 s",
        _RESPONSE,
        form=".3f",
        least=0.01,
    ),
    Definition(
        "touch_error_max_n",
        "largest touch error",
        "N",
        "largest absolute error in these 3 s",
        _RESPONSE,
    ),
    Definition(
        "touch_error_mean_n",
        "mean touch error",
        "N",
        "mean absolute error in these 3 s",
        _RESPONSE,
        least=0.02,
    ),
    Definition(
        "touch_error_deviation_n",
        "deviation of the touch error",
        "N",
        "standard deviation of the same",
        _RESPONSE,
    ),
    Definition(
        "settle_s",
        "settling time",
        "s",
        "time from the touch until the error stays within 10 % of the target, at least 1 N, up to 3 s",
        _RESPONSE,
        least=0.02,
    ),
    Definition(
        "settle_10n_s",
        "settling time, 10 N",
        "s",
        "the same within 10 N, for a target above 10 N",
        _RESPONSE,
        least=0.02,
    ),
    Definition(
        "step_rise_s",
        "rise of a step",
        "s",
        "time from 10 % to 90 % of a step of the target, slowest step",
        _RESPONSE,
        least=0.02,
    ),
    Definition(
        "step_overshoot_percent",
        "overshoot of a step",
        "%",
        "largest error beyond the new target, of the step, worst step",
        _RESPONSE,
        form=".1f",
        least=1.0,
    ),
    Definition(
        "step_settle_s",
        "settling of a step",
        "s",
        "time from the step until the error stays within 10 % of the step, slowest step",
        _RESPONSE,
        least=0.02,
    ),
    Definition(
        "step_error_n",
        "error after a step",
        "N",
        "mean error in the second half of the interval after a step, worst step",
        _RESPONSE,
        least=0.02,
    ),
    Definition(
        "smallest_step_n",
        "smallest step",
        "N",
        "smallest of repeated steps that the mean force follows by half or more, three standard errors above 0",
        _RESPONSE,
        form=".3g",
    ),
    Definition(
        "ramp_lag_s",
        "lag of a ramp",
        "s",
        "mean error in the last 70 % of a ramp of the target, divided by its rate; the largest",
        _RESPONSE,
        Good.NEAR_ZERO,
        ".3f",
    ),
    Definition(
        "sine_gain",
        "amplitude ratio",
        "",
        "amplitude of the force, of that of a sine of the target; the first period is left out",
        _RESPONSE,
        Good.NEAR_ONE,
        ".3f",
    ),
    Definition(
        "sine_phase_deg",
        "phase",
        "°",
        "phase of the force after that sine, negative for a delay",
        _RESPONSE,
        Good.NEAR_ZERO,
        ".1f",
    ),
    Definition(
        "disturbance_peak_n",
        "disturbance peak",
        "N",
        "largest absolute error while a fault moves or changes the surface",
        _RESPONSE,
        least=0.1,
    ),
    Definition(
        "disturbance_settle_s",
        "disturbance settling",
        "s",
        "time from the begin of that fault until the error stays within the band of the settling time",
        _RESPONSE,
        least=0.02,
    ),
    Definition(
        "disturbance_error_n",
        "disturbance error",
        "N",
        "mean error in the second half of that fault",
        _RESPONSE,
        Good.NEAR_ZERO,
        "+.2f",
    ),
    Definition(
        "disturbance_n_mm",
        "force per motion",
        "N/mm",
        "amplitude of the force, of that of an oscillating surface; the first period is left out",
        _RESPONSE,
        least=0.05,
    ),
    Definition(
        "drift_n_min",
        "drift",
        "N/min",
        "slope of the force over a constant target of at least 60 s, without the first 10 s",
        _RESPONSE,
        Good.NEAR_ZERO,
        "+.3f",
    ),
    Definition(
        "drift_true_n_min",
        "true drift",
        "N/min",
        "the same of the true force",
        _RESPONSE,
        Good.NEAR_ZERO,
        "+.3f",
    ),
    Definition(
        "track_error_max_n",
        "largest track error",
        "N",
        "largest absolute error from 3 s after the touch on",
        _RESPONSE,
    ),
    Definition(
        "track_error_mean_n",
        "mean track error",
        "N",
        "mean absolute error from 3 s after the touch on",
        _RESPONSE,
        least=0.02,
    ),
    Definition(
        "track_error_deviation_n",
        "deviation of the track error",
        "N",
        "standard deviation of the same",
        _RESPONSE,
    ),
    Definition(
        "force_reference_n", "target force", "N", "target force, positive while pressing", _RUN, Good.NONE
    ),
    Definition(
        "force_mean_steady_n", "mean steady force", "N", "mean force, last 40 samples", _RUN, Good.NONE
    ),
    Definition("cycle_rate_hz", "cycle rate", "Hz", "mean over the run", _RUN, Good.NONE),
    Definition(
        "line_floor_s",
        "line-time floor",
        "ms",
        "time of a cycle's characters on the line",
        _RUN,
        Good.NONE,
        ".1f",
        scale=1e3,
    ),
    Definition(
        "contact_force_mean_n",
        "mean contact force",
        "N",
        "mean force of the samples in contact",
        _CONTACT,
        Good.NONE,
        ".2f",
    ),
    Definition(
        "contact_force_rms_n",
        "RMS contact force",
        "N",
        "root mean square of the same",
        _CONTACT,
        Good.NONE,
        ".2f",
    ),
    Definition(
        "contact_force_deviation_n",
        "deviation of the contact force",
        "N",
        "standard deviation of the same",
        _CONTACT,
        Good.NONE,
        ".2f",
    ),
    Definition(
        "contact_force_peak_n", "peak contact force", "N", "largest of the same", _CONTACT, Good.NONE, ".2f"
    ),
    Definition(
        "contact_lateral_peak_n",
        "peak lateral force",
        "N",
        "largest force across the contact axis, in contact",
        _CONTACT,
        Good.NONE,
        ".2f",
    ),
    Definition(
        "contact_moment_peak_nm",
        "peak moment",
        "N·m",
        "largest magnitude of the moment, in contact",
        _CONTACT,
        Good.NONE,
        ".3f",
    ),
    Definition(
        "contact_s",
        "time in contact",
        "s",
        "time for which the force was above the threshold of the contact",
        _CONTACT,
        Good.NONE,
        ".2f",
    ),
    Definition("contacts", "contacts", "", "times that the force rose above it", _CONTACT, Good.NONE, ".0f"),
)
FIGURES: Mapping[str, Definition] = {one.key: one for one in _TABLE}
"""All figures, by key."""
MERIT = tuple(one for one in _TABLE if one.group is Group.MERIT)
"""Figures of merit, in display order."""
RESPONSE = tuple(one for one in _TABLE if one.group is Group.RESPONSE)
"""Response figures, in display order."""
CONTACT = tuple(one for one in _TABLE if one.group is Group.CONTACT)
"""Contact figures, in display order."""
TUNED = tuple(dict.fromkeys(one.key for one in (*MERIT, *_TABLE) if one.least is not None))
"""Figures that a search can minimise."""
JUDGED = tuple(one.key for one in _TABLE[: _TABLE.index(RESPONSE[-1]) + 1])
"""Figures of a run in a campaign that a criterion can refer to."""
COUNTED = ("faults_struck", "causes")
"""Figures that are mappings from a name to a count."""
WORDS = ("outcome", "retracted", "promises", *COUNTED)
"""Figures that are text."""


def title_of(column: str) -> str:
    """Return the column heading of a figure, of its standard deviation (`…_sd`), or of any other value."""
    key = column.removesuffix("_sd")
    if key not in FIGURES:
        return column.replace("_", " ")
    title = FIGURES[key].title
    return title if key == column else f"{title}, deviation"


def meaning_rows(keys: Iterable[str] = JUDGED) -> list[tuple[str, str, str, str]]:
    """Return key, label, meaning and preferred direction of each figure, for a document."""
    chosen = (FIGURES[key] for key in keys)
    return [(f"`{one.key}`", one.words, one.meaning, one.good.value or UNKNOWN) for one in chosen]
