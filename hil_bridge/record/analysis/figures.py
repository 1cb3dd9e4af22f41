"""The table of figures: what a run is judged by, once for summary, report, criteria, tuning, pages and documents.

A figure has one key, which tells its unit, and one set of words. What reads figures takes both from here.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

UNKNOWN = "–"
"""Stands for a figure that a run did not show."""


class Good(StrEnum):
    """The direction in which a figure gets better."""

    LESS = "less"
    NEAR_ZERO = "near 0"
    NONE = ""
    """It tells no merit, or is a word."""


class Group(StrEnum):
    """Owners of a figure."""

    MERIT = "figures of merit"
    """Of the tracked force: `Summary.figures`, and the fields of `FiguresOfMerit`."""
    RUN = "run"
    """Other facts of a run: fields of `Summary`."""
    CONTACT = "contact"
    """Of the force while the tool touches, whatever was wanted: `Summary.contact`."""
    CAMPAIGN = "campaign"
    """Figures that a campaign adds from the truth of an emulated cell."""


@dataclass(frozen=True, slots=True)
class Definition:
    """One figure."""

    key: str
    words: str
    unit: str
    how: str
    """How it is computed."""
    group: Group = Group.MERIT
    good: Good = Good.LESS
    form: str = ".2f"
    """Format of its number; empty for a word."""
    least: float | None = None
    """Difference that does not matter, in its unit: the least scale of a search. None: no search is for it. Chosen."""
    of_several: str = ""
    """How it is computed of a program with several strokes, where that is another way."""
    scale: float = 1.0
    """From the value of a summary to the unit that is shown."""

    @property
    def title(self) -> str:
        """Words and unit, as above a column."""
        return f"{self.words}, {self.unit}" if self.unit else self.words

    @property
    def meaning(self) -> str:
        """How it is computed, with its unit, in a line."""
        return f"{self.how}, {self.unit}" if self.unit else self.how

    def text(self, value: float | None) -> str:
        """Format a value with its unit, or a dash."""
        return quantity(value, self.scale, self.form, self.unit)


def quantity(value: float | None, scale: float, form: str, unit: str) -> str:
    """Format a value with its unit, or a dash."""
    return UNKNOWN if value is None else f"{value * scale:{form}} {unit}".rstrip().replace("-", "−")


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
        "largest true contact force, looked at every 10 ms",
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
        "largest true force less that bound and what the faults add to it; left out where that is infinite",
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
    Definition("promises", "broken promises", "", "the same in words", _CAMPAIGN, Good.NONE, ""),
    Definition(
        "duration_s", "duration", "s", "duration of the run by its own time", _CAMPAIGN, Good.NONE, ".1f"
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
        "time from the end of the last fault until the true force stays within 20 % of the wanted one",
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
        "force_reference_n", "target force", "N", "wanted force, positive while pressing", _RUN, Good.NONE
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
"""Every figure by its key."""
MERIT = tuple(one for one in _TABLE if one.group is Group.MERIT)
"""Figures of merit, in the order in which they are shown."""
CONTACT = tuple(one for one in _TABLE if one.group is Group.CONTACT)
"""Figures of a contact, in the order in which they are shown."""
TUNED = tuple(dict.fromkeys(one.key for one in (*MERIT, *_TABLE) if one.least is not None))
"""Figures that a search may make small."""
JUDGED = tuple(one.key for one in _TABLE[: _TABLE.index(MERIT[-1]) + 1])
"""Figures of a campaign's run, which a criterion may name."""
COUNTED = ("faults_struck", "causes")
"""Figures that are counts by name."""
WORDS = ("outcome", "retracted", "promises", *COUNTED)
"""Figures that are not numbers."""


def title_of(column: str) -> str:
    """Words above a column that holds a figure, its deviation as `…_sd`, or something else."""
    key = column.removesuffix("_sd")
    if key not in FIGURES:
        return column.replace("_", " ")
    words = FIGURES[key].title
    return words if key == column else f"{words}, deviation"


def meaning_rows(keys: Iterable[str] = JUDGED) -> list[tuple[str, str, str, str]]:
    """Key, words, meaning and good direction of figures, for a document."""
    chosen = (FIGURES[key] for key in keys)
    return [(f"`{one.key}`", one.words, one.meaning, one.good.value or UNKNOWN) for one in chosen]
