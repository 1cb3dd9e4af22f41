"""A panel's answers for people to read. An answer that lacks something shows a dash."""

from collections.abc import Iterator, Mapping
from typing import Any

_FLAG_TEXTS = {
    "emergency_stop": ("EMERGENCY STOP", ""),
    "work_stop": ("WORK STOP", ""),
    "key_auto": ("key in AUTO", "key in MANUAL"),
    "local": ("link control taken back", "link control given"),
    "programming_unit": ("programming unit connected", ""),
    "interrupt_permitted": ("interrupt permitted", ""),
    "execution": ("execution", ""),
}
"""Words for a flag that is set, and for one that is not."""


def state_text(state: Mapping[str, Any]) -> str:
    """The state in some lines."""
    flags = state.get("flags")
    known = flags if isinstance(flags, dict) else {}
    said = [texts[0] if known[name] else texts[1] for name, texts in _FLAG_TEXTS.items() if name in known]
    activity = state.get("activity", "none")
    armed, lasting = state.get("armed"), state.get("lasting")
    rows = {
        "mode": f"{state.get('mode', '–')}{'' if activity == 'none' else f', {activity}'}",
        "state": ", ".join(filter(None, said)) or "–",
        "points": f"{state.get('points_waiting', '–')} of {state.get('queue_depth', '–')} waiting",
        "program": f"{state.get('program', '–')}, instruction {state.get('instruction', '–')}",
        "position": f"{_numbers(state.get('position_mm'))} mm reported",
        "": f"{_numbers(state.get('true_position_mm'))} mm true",
        "joints": f"{_numbers(state.get('joints_deg'))} °",
        "orders": f"{state.get('answered', '–')} answered, {state.get('refused', '–')} of them refused, "
        f"{state.get('lost', '–')} lost",
        "last refusal": state.get("last_refusal") or "none",
        "faults": ", ".join(f"{name} ({count})" for name, count in armed.items())
        if isinstance(armed, dict) and armed
        else "none waiting",
        "lasting": ", ".join(map(str, lasting)) if isinstance(lasting, list) and lasting else "none",
    }
    return "\n".join(f"{name:<14}{text}" for name, text in rows.items())


def faults_text(targets: Mapping[str, Any]) -> str:
    """Every fault of every target with its parameters, defaults and ranges."""
    lines = []
    for target, faults in _tables(targets):
        lines.append(target)
        for name, fault in _tables(faults):
            lines.append(f"  {name:<20}{fault.get('meaning', '')}")
            lines += [
                f"{'':<24}{key}{_default(item)}: {item.get('meaning')}, {item.get('range')}"
                for key, item in _tables(fault.get("parameters", {}))
            ]
    return "\n".join(lines)


def _tables(table: object) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """The items of a table that are tables themselves."""
    if isinstance(table, Mapping):
        yield from ((str(name), item) for name, item in table.items() if isinstance(item, Mapping))


def _default(parameter: Mapping[str, Any]) -> str:
    default = parameter.get("default")
    return "" if default is None else f"={default}"


def _numbers(values: object) -> str:
    if not isinstance(values, list):
        return "–"
    return "".join(f"{value:>10.3f}" if isinstance(value, (int, float)) else " –" for value in values)
