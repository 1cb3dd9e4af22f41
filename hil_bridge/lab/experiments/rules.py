"""Table 3: the printed gain matrix against the one that the recovered rules give."""

from collections.abc import Sequence
from typing import Any

from hil_bridge.control import computed_matrix, infer
from hil_bridge.control.laws.tables import GAIN_MATRIX, LEVELS
from hil_bridge.lab.experiments.drawing import Sheet
from hil_bridge.lab.experiments.results import Claim, Experiment, Findings, Job, Row, figure


def evaluate(done: Sequence[Job], results: Sequence[Any]) -> Findings:
    """Both matrices entry by entry, and a picture of the printed one with the differing entries marked."""
    computed = computed_matrix()
    table: list[Row] = [
        {
            "error_level": error,
            "change_level": change,
            "printed": GAIN_MATRIX[row][column],
            "computed": computed[row][column],
            "before_rounding": round(infer(error, change), 4),
        }
        for row, error in enumerate(LEVELS)
        for column, change in enumerate(LEVELS)
    ]
    with Sheet(7.6, 6.2) as sheet:
        (ax,) = sheet.axes
        image = ax.imshow(
            computed, cmap="PuOr", vmin=-6, vmax=6, origin="lower", extent=(-6.5, 6.5, -6.5, 6.5)
        )
        for entry in table:
            differs = entry["printed"] != entry["computed"]
            ax.text(
                figure(entry, "change_level"),
                figure(entry, "error_level"),
                f"{entry['computed']}" + (f"\n({entry['printed']})" if differs else ""),
                ha="center",
                va="center",
                fontsize=8.5 if differs else 9.5,
                fontweight="bold" if differs else "normal",
                color="white" if abs(figure(entry, "computed")) > 4 else "black",
                bbox={"boxstyle": "square,pad=0.25", "facecolor": "none", "edgecolor": "black", "lw": 2.0}
                if differs
                else None,
            )
        ax.set_xticks(LEVELS)
        ax.set_yticks(LEVELS)
        ax.grid(visible=False)
        ax.set_xlabel("level of the change of the force error")
        ax.set_ylabel("level of the force error")
        ax.set_title("output level computed from the rules; framed: (printed) differs")
        sheet.figure.colorbar(image, ax=ax, shrink=0.8, label="output level, resolution steps of 0.125 mm")
        picture = sheet.png()
    return Findings(tuple(table), picture)


def describe(table: Sequence[Row]) -> tuple[str, tuple[Claim, ...]]:
    """Which entries agree, and which do not."""
    wrong = [row for row in table if row["printed"] != row["computed"]]
    at = {
        (int(figure(row, "error_level")), int(figure(row, "change_level"))): figure(row, "printed")
        for row in table
    }
    odd = [(error, change) for (error, change), value in at.items() if at[-error, -change] != -value]
    named = ", ".join(
        f"G({_signed(row['error_level'])}, {_signed(row['change_level'])}) is printed "
        f"{_signed(row['printed'])} and computed {_signed(row['computed'])} "
        f"({_signed(row['before_rounding'])} before rounding)"
        for row in wrong
    )
    text = (
        f"The paper prints Table 3 but not the rules behind it. Mamdani inference on Table 2 with the "
        f"recovered rules gives {len(table) - len(wrong)} of its {len(table)} entries. What differs: "
        f"{named or 'nothing'}. The printed matrix should be antisymmetric, G(−e, −ce) = −G(e, ce); it is "
        f"not at {', '.join(f'({_signed(e)}, {_signed(c)})' for e, c in odd) or 'no entry'}, which points "
        f"at the same entry: a slip in the paper."
    )
    claim = Claim(
        "Table 3 follows from rules after MacVicar-Whelan",
        f"{len(table) - len(wrong)} of {len(table)} entries do; {named or 'nothing'} differs",
    )
    return text, (claim,)


def _signed(value: Any) -> str:
    return "0" if value == 0 else f"{value:+g}".replace("-", "−")


RULES = Experiment("rules", "Table 3: gain matrix from the rules", lambda seeds: [], evaluate, describe)
