"""Result of a benchmark: figures beside their baselines and targets."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import msgspec


@dataclass(frozen=True, slots=True)
class Target:
    """Limit that a figure has to reach."""

    of: Literal["value", "ratio"]
    limit: float
    least: bool = False
    """The figure must be at least that much; otherwise at most."""
    aim: float | None = None
    """Limit that would be better still."""

    def __str__(self) -> str:
        sign, times = ("≥" if self.least else "≤"), (" ×" if self.of == "ratio" else "")
        aim = "" if self.aim is None else f" (aim {self.aim:g}{times})"
        return f"{sign} {self.limit:.3g}{times}{aim}"


@dataclass(frozen=True, slots=True)
class Figure:
    """One number that was measured."""

    name: str
    value: float
    unit: str = ""
    baseline: float | None = None
    """The same quantity of what it is compared with, in the same unit."""
    against: str = ""
    """Meaning of the figure."""
    target: Target | None = None

    @property
    def ratio(self) -> float | None:
        """Value by baseline."""
        return self.value / self.baseline if self.baseline else None

    @property
    def met(self) -> bool | None:
        """Whether the target was reached; None without one."""
        if self.target is None:
            return None
        got = self.value if self.target.of == "value" else self.ratio
        if got is None:
            return None
        return got >= self.target.limit if self.target.least else got <= self.target.limit

    @property
    def _digits(self) -> int:
        """Digits of the ratio: more where three would not tell on which side of its target it is."""
        target, ratio = self.target, self.ratio
        if target is None or target.of != "ratio" or ratio is None:
            return 3
        return 4 if number(ratio) == number(target.limit) else 3

    def cells(self) -> tuple[str, ...]:
        """Name, value, baseline, ratio, target and whether it was met, as texts."""
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
        """All of it on one line, for a terminal."""
        name, value, baseline, ratio, target, met = self.cells()
        judged = f"; {target}: {'met' if met == 'yes' else 'NOT met'}" if met else ""
        return f"{name}: {value}" + (f"; {baseline}, ratio {ratio}" if baseline else "") + judged


@dataclass(frozen=True, slots=True)
class Report:
    """All that one benchmark says."""

    figures: tuple[Figure, ...]
    left_out: tuple[str, ...] = ()
    """Figures that could not be measured here, with the reason: a sentence each."""

    def as_json(self) -> dict[str, Any]:
        """Content of the file of results; ratio and judgement are written out for readers of that file."""
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
        """Figures from the output of `as_json`."""
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
        """Value that one in a hundred is above."""
        return self.at(0.99)

    def at(self, part: float) -> float:
        """Value that this part of them, 0 … 1, does not exceed; with 1 the largest."""
        ordered = sorted(self.values)
        return ordered[max(0, min(len(ordered) - 1, math.ceil(part * len(ordered)) - 1))]


def number(value: float, significant: int = 3) -> str:
    """Text with so many significant digits, without an exponent for numbers that people read daily."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    digits = max(0, significant - 1 - math.floor(math.log10(abs(value))))
    return f"{value:,.{min(digits, 6)}f}".replace(",", "\u202f")


def _rounded(value: Any) -> Any:
    """Four significant digits are more than any of these figures is worth."""
    if isinstance(value, float) and math.isfinite(value):
        return float(f"{value:.4g}")
    return value
