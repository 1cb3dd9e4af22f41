"""Table of figures: the results by which a run is judged, shared by summary, report, criteria, tuning and pages.

Each figure has one key, which includes its unit, and one description. All code that uses figures reads both from
here.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

UNKNOWN = "–"
"""Placeholder for a figure without a value."""


class Good(StrEnum):
    """Direction in which a figure improves."""

    LESS = "less"
    NEAR_ZERO = "near 0"
    NONE = ""
    """The figure has no preferred direction, or is text."""


class Group(StrEnum):
    """Group of figures."""

    MERIT = "figures of merit"
    """Figures of the tracked force: `Summary.figures` and the fields of `FiguresOfMerit`."""
    RUN = "run"
    """Other results of a run, which are fields of `Summary`."""
    CONTACT = "contact"
    """Force statistics while the tool is in contact, with or without a target force: `Summary.contact`."""
    CAMPAIGN = "campaign"
    """Figures that a campaign adds from the ground truth of an emulated cell."""


@dataclass(frozen=True, slots=True)
class Definition:
    """Definition of a figure."""

    key: str
    words: str
    unit: str
    how: str
    """Description of how the figure is computed."""
    group: Group = Group.MERIT
    good: Good = Good.LESS
    form: str = ".2f"
    """Format of the number; empty for text."""
    least: float | None = None
    """Smallest relevant difference, in the unit of the figure, which is the smallest scale of a search. None if a
    search cannot use the figure. Chosen.
    """
    of_several: str = ""
    """Description of how the figure is computed for a program with several strokes, if different."""
    scale: float = 1.0
    """Factor from the value in a summary to the displayed unit."""

    @property
    def title(self) -> str:
        """Label and unit of the figure, as a column heading."""
        return f"{self.words}, {self.unit}" if self.unit else self.words

    @property
    def meaning(self) -> str:
        """Description of how the figure is computed, with its unit, in one line."""
        return f"{self.how}, {self.unit}" if self.unit else self.how

    def text(self, value: float | None) -> str:
        """Format a value with its unit; return a dash if it is unknown."""
        return quantity(value, self.scale, self.form, self.unit)


def quantity(value: float | None, scale: float, form: str, unit: str) -> str:
    """Format a value with its unit; return a dash if it is unknown. A signed zero becomes `0`."""
    if value is None:
        return UNKNOWN
    text = f"{value * scale:{form}}"
    if text[0] in "+-" and not text.strip("+-0."):
        text = "0"
    named = "cycle" if (text, unit) == ("1", "cycles") else unit
    return f"{text} {named}".rstrip().replace("-", "−")


def concise(value: float | None, scale: float, form: str, unit: str) -> str:
    """Format a value as `quantity` does, but leave out decimals beyond three significant digits."""
    if value is None or not math.isfinite(value) or not form.endswith("f"):
        return quantity(value, scale, form, unit)
    head, _, places = form.removesuffix("f").partition(".")
    before = len(str(int(abs(round(value * scale, int(places))))).lstrip("0"))
    return quantity(value, scale, f"{head}.{max(0, min(int(places), 3 - before))}f", unit)


_CAMPAIGN, _CONTACT, _RUN = Group.CAMPAIGN, Group.CONTACT, Group.RUN
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
        "true force beyond its bound",
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
    Definition("rise_s", "rise time", "s", "the rise as time", least=0.02),
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
CONTACT = tuple(one for one in _TABLE if one.group is Group.CONTACT)
"""Contact figures, in display order."""
TUNED = tuple(dict.fromkeys(one.key for one in (*MERIT, *_TABLE) if one.least is not None))
"""Figures that a search can minimise."""
JUDGED = tuple(one.key for one in _TABLE[: _TABLE.index(MERIT[-1]) + 1])
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
