"""The results of a campaign as a table: a row a run."""

from collections.abc import Callable, Mapping

from hil_bridge.lab.campaign.criteria import Figures, figure_text
from hil_bridge.lab.campaign.store import Store
from hil_bridge.record.analysis.figures import JUDGED
from hil_bridge.record.export.tables import Table, as_csv, as_parquet

FORMATS: Mapping[str, Callable[[Table], bytes]] = {"csv": as_csv, "parquet": as_parquet}
"""Formats of a table, by the suffix of the file."""
_COLUMNS = (
    "key",
    "seed",
    "cell",
    "fault",
    "phase",
    "passed",
    "failed",
    "cause",
    "wall_s",
    "recording",
    "code",
)


def run_table(store: Store) -> Table:
    """Every run that is kept. A figure that a run does not have is empty, and so is an infinite one."""
    cases, code = store.plan().cases, store.fact("code")
    rows = []
    for run in store.runs():
        case = cases[run.number]
        facts = (
            run.key,
            run.seed,
            case.cell,
            case.fault,
            case.phase,
            run.passed,
            "; ".join(run.failed),
            run.cause,
        )
        rows.append(
            {
                **dict(zip(_COLUMNS, (*facts, run.wall_s, run.recording, code), strict=True)),
                **_plain(run.figures),
            }
        )
    return Table((*_COLUMNS, *JUDGED), tuple(rows))


def _plain(figures: Figures) -> dict[str, object]:
    """Figures with those in words as one text."""
    return {name: figure_text(value) if isinstance(value, dict) else value for name, value in figures.items()}
