"""Results of a benchmark: figures with their baselines and targets."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import msgspec


@dataclass(frozen=True, slots=True)
class Target:
    """Limit for a figure."""

    of: Literal["value", "ratio"]
    limit: float
    least: bool = False
    """Whether the limit is a minimum; otherwise it is a maximum."""
    aim: float | None = None
    """Better limit, which is the aim."""

    def __str__(self) -> str:
        sign, times = ("≥" if self.least else "≤"), (" ×" if self.of == "ratio" else "")
        aim = "" if self.aim is None else f" (aim {self.aim:g}{times})"
        return f"{sign} {self.limit:.3g}{times}{aim}"


@dataclass(frozen=True, slots=True)
class Figure:
    """Measured value."""

    name: str
    value: float
    unit: str = ""
    baseline: float | None = None
    """Value of the baseline for the same quantity, in the same unit."""
    against: str = ""
    """Description of the baseline."""
    target: Target | None = None

    @property
    def ratio(self) -> float | None:
        """Ratio of the value to the baseline."""
        return self.value / self.baseline if self.baseline else None

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None if there is no target."""
        if self.target is None:
            return None
        got = self.value if self.target.of == "value" else self.ratio
        if got is None:
            return None
        return got >= self.target.limit if self.target.least else got <= self.target.limit

    @property
    def _digits(self) -> int:
        """Number of digits of the ratio. It exceeds three if three digits would hide on which side of the target
        the ratio is.
        """
        target, ratio = self.target, self.ratio
        if target is None or target.of != "ratio" or ratio is None:
            return 3
        return 4 if number(ratio) == number(target.limit) else 3

    def cells(self) -> tuple[str, ...]:
        """Name, value, baseline, ratio, target and verdict, as texts."""
        baseline = "" if self.baseline is None else f"{number(self.baseline)} {self.unit} ({self.against})"
        return (
            self.name,
            f"{number(self.value)} {self.unit}",
            baseline,
            "" if self.ratio is None else f"{number(self.ratio, self._digits)} ×",
            "" if self.target is None else str(self.target),
            {True: "yes", False: "no", None: ""}[self.met],
        )

    def line(self) -> str:
        """Figure as one line of text."""
        name, value, baseline, ratio, target, met = self.cells()
        judged = f"; {target}: {'met' if met == 'yes' else 'NOT met'}" if met else ""
        return f"{name}: {value}" + (f"; {baseline}, ratio {ratio}" if baseline else "") + judged


@dataclass(frozen=True, slots=True)
class Report:
    """Results of one benchmark."""

    figures: tuple[Figure, ...]
    left_out: tuple[str, ...] = ()
    """Figures that could not be measured on this machine: one sentence each, with the reason."""

    def as_json(self) -> dict[str, Any]:
        """Return the content of the results file. It includes ratio and verdict for readers of that file."""
        return {
            "figures": [
                {key: _rounded(value) for key, value in asdict(figure).items() if value not in (None, "")}
                | ({} if figure.ratio is None else {"ratio": _rounded(figure.ratio)})
                | ({} if figure.met is None else {"met": figure.met})
                for figure in self.figures
            ],
            "left_out": list(self.left_out),
        }

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> "Report":
        """Return the report that `as_json` converted."""
        return msgspec.convert(values, cls)


@dataclass(frozen=True, slots=True)
class Spread:
    """Percentiles of many measurements of one quantity."""

    values: Sequence[float] = field(repr=False)

    @property
    def p50(self) -> float:
        """Median."""
        return statistics.median(self.values)

    @property
    def p99(self) -> float:
        """99th percentile."""
        return self.at(0.99)

    def at(self, part: float) -> float:
        """Return the quantile for this share, 0 … 1. The quantile for 1 is the maximum."""
        ordered = sorted(self.values)
        return ordered[max(0, min(len(ordered) - 1, math.ceil(part * len(ordered)) - 1))]


def number(value: float, significant: int = 3) -> str:
    """Return a number as text with this many significant digits. Common magnitudes have no exponent."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    digits = max(0, significant - 1 - math.floor(math.log10(abs(value))))
    return f"{value:,.{min(digits, 6)}f}".replace(",", "\u202f")


def _rounded(value: Any) -> Any:
    """Round to four significant digits, which is sufficient for these figures."""
    if isinstance(value, float) and math.isfinite(value):
        return float(f"{value:.4g}")
    return value
