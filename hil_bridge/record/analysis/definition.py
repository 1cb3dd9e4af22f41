"""Definition of a figure, and the text of its values."""

import math
from dataclasses import dataclass
from enum import StrEnum

UNKNOWN = "–"
"""Placeholder for a figure without a value."""


class Good(StrEnum):
    """Direction in which a figure improves."""

    LESS = "less"
    NEAR_ZERO = "near 0"
    NEAR_ONE = "near 1"
    NONE = ""
    """The figure has no preferred direction, or is text."""


class Group(StrEnum):
    """Group of figures."""

    MERIT = "figures of merit"
    """Figures of the tracked force: `Summary.figures` and the fields of `FiguresOfMerit`."""
    RESPONSE = "response"
    """Response to a touch, a changing target and a moved surface: `Summary.response`."""
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

    def cost(self, value: float) -> float | None:
        """Return a number that is the smaller, the better the value is; None without a preferred direction."""
        match self.good:
            case Good.LESS:
                return value
            case Good.NEAR_ZERO:
                return abs(value)
            case Good.NEAR_ONE:
                return abs(value - 1.0)
        return None

    @property
    def title(self) -> str:
        """Label and unit of the figure, as a column heading."""
        return f"{self.words}, {self.unit}" if self.unit else self.words

    @property
    def meaning(self) -> str:
        """Description of how the figure is computed, with its unit, in one line."""
        return f"{self.how}, {self.unit}" if self.unit else self.how

    @property
    def infinite(self) -> str:
        """Text of an infinite value: a time that never ended, or a quantity that does not exist."""
        return "never" if self.unit in ("s", "cycles") else "none"

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
    named = "cycle" if (text.lstrip("+-"), unit) == ("1", "cycles") else unit
    return f"{text} {named}".rstrip().replace("-", "−")


def concise(value: float | None, scale: float, form: str, unit: str) -> str:
    """Format a value as `quantity` does, but leave out decimals beyond three significant digits."""
    if value is None or not math.isfinite(value) or not form.endswith("f"):
        return quantity(value, scale, form, unit)
    return quantity(value, scale, f"{form.partition('.')[0]}.{decimals(value * scale, form)}f", unit)


def decimals(value: float, form: str) -> int:
    """Return the number of decimals with which `concise` formats a finite value in its displayed unit; `form` ends
    with `f`.
    """
    places = int(form.removesuffix("f").partition(".")[2])
    before = len(str(int(abs(round(value, places)))).lstrip("0"))
    return max(0, min(places, 3 - before))


def difference(before: float, after: float, figure: Definition) -> str:
    """Format how much larger `after` is, from the displayed values and as `concise`; percentages differ by points."""
    form, values = f"+{figure.form.lstrip('+')}", [value * figure.scale for value in (before, after)]
    if form.endswith("f"):
        form = f"+.{max(decimals(value, figure.form) for value in values)}f"
    unit = "points" if figure.unit == "%" else figure.unit
    return concise(rounded(after, figure) - rounded(before, figure), 1.0, form, unit)


def rounded(value: float, figure: Definition) -> float:
    """Return a finite value in the displayed unit, rounded as `concise` formats it."""
    value *= figure.scale
    form = figure.form
    return round(value, decimals(value, form)) if form.endswith("f") else float(f"{value:{form}}")
