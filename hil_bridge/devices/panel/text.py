"""Text form of a panel's answers. A missing state is displayed as a dash."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from hil_bridge.errors.failures import one_line


def state_text(answer: Mapping[str, Any]) -> str:
    """Return the state as lines."""
    rows = answer.get("rows")
    known = rows if isinstance(rows, dict) else {}
    return "\n".join(f"{one_line(str(name)):<14}{one_line(str(text))}" for name, text in known.items()) or "–"


def controls_text(controls: Mapping[str, Any]) -> str:
    """Return every control with its positions and meaning, as lines."""
    calls = [
        (f"{one_line(name)} {'|'.join(map(str, _listed(control.get('to'))))}", control.get("meaning", ""))
        for name, control in _tables(controls)
    ]
    width = max((len(call) for call, _ in calls), default=0)
    return "\n".join(f"{one_line(call):<{width}}  {one_line(str(meaning))}" for call, meaning in calls) or "–"


def _listed(positions: object) -> Sequence[object]:
    return positions if isinstance(positions, list | tuple) else ()


def faults_text(targets: Mapping[str, Any]) -> str:
    """Return every fault of every target with its parameters, defaults and ranges, as lines."""
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
    """Yield the items of a table that are tables themselves."""
    if isinstance(table, Mapping):
        yield from ((str(name), item) for name, item in table.items() if isinstance(item, Mapping))


def _default(parameter: Mapping[str, Any]) -> str:
    default = parameter.get("default")
    return "" if default is None else f"={default}"
