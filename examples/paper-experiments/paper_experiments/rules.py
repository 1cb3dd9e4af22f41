"""Table 3: the printed gain matrix compared with the one from the recovered rules."""

from collections.abc import Sequence
from typing import Any

from hil_bridge.control import computed_matrix, infer
from hil_bridge.control.laws.tables import GAIN_MATRIX, LEVELS
from paper_experiments.results import Claim, Experiment, Findings, Job, Row, rows_where

ABOUT = (
    "The paper prints Table 3 but not its rules. The table below results from Mamdani inference on Table 2 with the "
    "recovered rules: output levels, in resolution steps of 0.125 mm, by the level of the force error (rows) and of "
    "its change (columns). A different printed entry is in brackets. The printed matrix should be antisymmetric, "
    "G(−e, −ce) = −G(e, ce). Only the entry in brackets is not: an error in the paper."
)


def evaluate(done: Sequence[Job], results: Sequence[Any]) -> Findings:
    """Return both matrices entry by entry."""
    computed = computed_matrix()
    return Findings(
        tuple(
            {
                "error_level": error,
                "change_level": change,
                "printed": GAIN_MATRIX[row][column],
                "computed": computed[row][column],
                "before_rounding": round(infer(error, change), 4),
            }
            for row, error in enumerate(LEVELS)
            for column, change in enumerate(LEVELS)
        )
    )


def claims(table: Sequence[Row]) -> tuple[Claim, ...]:
    """Return how many entries agree, and which differ."""
    wrong = [row for row in table if row["printed"] != row["computed"]]
    named = ", ".join(
        f"G({_signed(row['error_level'])}, {_signed(row['change_level'])}) is printed "
        f"{_signed(row['printed'])} and computed {_signed(row['computed'])} "
        f"({_signed(row['before_rounding'])} before rounding)"
        for row in wrong
    )
    found = f"{len(table) - len(wrong)} of {len(table)} entries do; {named or 'nothing'} differs"
    return (Claim("Table 3 follows from rules after MacVicar-Whelan", found),)


def _matrix(table: Sequence[Row]) -> list[Row]:
    matrix: list[Row] = []
    for level in LEVELS:
        entries = {_signed(row["change_level"]): _entry(row) for row in rows_where(table, error_level=level)}
        matrix.append({"error \\ change": _signed(level), **entries})
    return matrix


def _entry(row: Row) -> str:
    differs = row["printed"] != row["computed"]
    return f"{row['computed']} ({row['printed']})" if differs else f"{row['computed']}"


def _signed(value: Any) -> str:
    return "0" if value == 0 else f"{value:+g}".replace("-", "−")


RULES = Experiment(
    "rules",
    "Table 3: gain matrix from the rules",
    ABOUT,
    lambda seeds: [],
    evaluate,
    claims,
    summary=_matrix,
)
