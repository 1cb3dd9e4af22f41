"""Results of a campaign as a table, one row per run."""

import math
from collections.abc import Callable, Mapping

from hil_bridge.lab.campaign.criteria import Figures, figure_text
from hil_bridge.lab.campaign.store import Store
from hil_bridge.record.analysis.figures import JUDGED
from hil_bridge.record.export.tables import Table, as_csv, as_parquet

FORMATS: Mapping[str, Callable[[Table], bytes]] = {"csv": as_csv, "parquet": as_parquet}
"""Table formats, by file suffix."""
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
    """Return every stored run as a row. A missing or infinite figure is empty."""
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
        figures = (_figure(run.figures, name) for name in JUDGED)
        rows.append((*facts, run.wall_s, run.recording, code, *figures))
    names = (*_COLUMNS, *JUDGED)
    return dict(zip(names, zip(*rows, strict=True) if rows else [()] * len(names), strict=True))


def _figure(figures: Figures, name: str) -> object:
    """Return a figure of a run, with a table as one text; None if the run does not have the figure."""
    value = figures.get(name)
    if isinstance(value, dict):
        return figure_text(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value
