"""Text that describes a campaign run: its case, its drawn settings and faults, and how it ended."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from hil_bridge.errors.rounding import three_digits
from hil_bridge.lab.campaign.criteria import figure_text
from hil_bridge.lab.campaign.plan import Case, Plan, fault_label, faults_of_table
from hil_bridge.lab.campaign.store import Done


def fault_of(case: Case) -> str:
    """Format the fault of a case with its phase."""
    return f"{case.fault} {case.phase}".rstrip()


def faults_of_run(case: Case, done: Done) -> str:
    """Format the faults of a run: the fault of its case, or the faults drawn for it, with three digits."""
    if "config" not in json.loads(done.table):
        return fault_of(case)
    faults = [
        f"{fault_label(_round(fault))} {fault.get('phase', '')}".rstrip()
        for fault in faults_of_table(done.table)
    ]
    return "; ".join(faults) or "none"


def _round(table: Mapping[str, Any]) -> dict[str, Any]:
    """Format the drawn numbers of a table with three significant digits."""
    return {
        key: _round(value)
        if isinstance(value, dict)
        else three_digits(value)
        if isinstance(value, float)
        else value
        for key, value in table.items()
    }


def settings_of_run(done: Done) -> str:
    """Format the drawn settings; empty if there are none."""
    settings = json.loads(done.table).get("config", {})
    return ", ".join(f"{key} {json.dumps(value)}" for key, value in settings.items())


def describe_run(plan: Plan, done: Done, label: str) -> Iterator[str]:
    """Yield the description of a run, line by line."""
    case, figures = plan.cases[done.number], done.figures
    forces = ""
    if (bound := figures.get("force_bound_n")) is not None and figures.get("force_true_max_n") is not None:
        forces = f": true force {figures['force_true_max_n']:.1f} N, bound {bound:.1f} N"
    yield f"{label}{forces}; {done.outcome}{done.cause and f', {done.cause}'}"
    if promises := figures.get("promises"):
        yield f"  broken: {figure_text(promises)}"
    yield f"  {case.cell}; faults: {faults_of_run(case, done)}"
    if settings := settings_of_run(done):
        yield f"  {settings}"


def hunt_values(plan: Plan, done: Done) -> dict[str, object]:
    """Return the worst run of a hunt as values for JSON output."""
    case = plan.cases[done.number]
    return {
        "key": done.key,
        "cell": case.cell,
        "faults": faults_of_table(done.table),
        "settings": json.loads(done.table).get("config", {}),
        "outcome": done.outcome,
        "cause": done.cause,
        "figures": done.figures,
    }
