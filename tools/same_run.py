"""Compare two recordings cycle by cycle: `python -m tools.same_run BEFORE.mcap AFTER.mcap`.

Forces, commands, poses and verdicts must be equal to the last bit; the exit code is then 0, else 1. Other differences
are listed and do not affect the exit code: other fields, fields that only one recording has, configuration and other
metadata. The messages are read directly from the file, so recordings of different versions can be compared.
"""

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

from mcap.exceptions import McapError
from mcap.reader import make_reader

JUDGED = {
    "cycle": "cycles",
    "phase": "verdicts",
    "force": "forces",
    "wrench": "forces",
    "position": "poses",
    "quaternion": "poses",
    "depth": "poses",
    "target": "commands",
    "depth_commanded": "commands",
    "travel_commanded": "commands",
    "correction": "commands",
    "verdict": "verdicts",
    "reasons": "verdicts",
}
"""Fields of a cycle that must be equal, with their descriptions."""
CYCLES = "/cycle"

Values: TypeAlias = Mapping[str, object]


class Run(NamedTuple):
    """Values of a recording, by name with dots."""

    cycles: Sequence[Values]
    metadata: Values


def flat(value: object, name: str = "") -> dict[str, object]:
    """Return every plain value in nested tables, by its name with dots. A text that contains JSON counts as a table."""
    if isinstance(value, str) and value.startswith("{"):
        try:
            value = json.loads(value)
        except ValueError:
            return {name: value}
    if not isinstance(value, Mapping):
        return {name: value}
    parts = (flat(each, f"{name}.{key}" if name else key) for key, each in value.items())
    return {key: each for part in parts for key, each in part.items()}


def read(path: Path) -> Run:
    """Return the cycles and the metadata of a recording."""
    with path.open("rb") as file:
        reader = make_reader(file)
        cycles = [flat(json.loads(message.data)) for _, _, message in reader.iter_messages(CYCLES)]
        metadata = {each.name: dict(each.metadata) for each in reader.iter_metadata()}
    return Run(cycles, flat(metadata))


def only_in_one(before: Iterable[str], after: Iterable[str], kind: str) -> Iterable[str]:
    """Describe the names that one side has and the other does not."""
    old, new = set(before), set(after)
    yield from (f"{kind} only before: {name}" for name in sorted(old - new))
    yield from (f"{kind} only after: {name}" for name in sorted(new - old))


def compare(before: Run, after: Run) -> tuple[list[str], bool]:
    """Return the differences, one per line, and whether all fields in JUDGED are equal."""
    differences: list[str] = []
    if not before.cycles or len(before.cycles) != len(after.cycles):
        differences.append(f"DIFFERENT cycles: {len(before.cycles)} before, {len(after.cycles)} after")
    names = [list(dict.fromkeys(name for cycle in run.cycles for name in cycle)) for run in (before, after)]
    for name in (name for name in names[0] if name in names[1] or name in JUDGED):
        pairs = [
            (old.get(name), new.get(name)) for old, new in zip(before.cycles, after.cycles, strict=False)
        ]
        unlike = [at for at, (old, new) in enumerate(pairs) if old != new]
        if unlike:
            old, new = pairs[unlike[0]]
            kind = f"DIFFERENT {JUDGED[name]}" if name in JUDGED else "field"
            number = before.cycles[unlike[0]].get("cycle")
            differences.append(
                f"{kind}: {name} in {len(unlike)} cycles, first in {number}: {old} before, {new} after"
            )
    equal = not any(line.startswith("DIFFERENT") for line in differences)
    differences += only_in_one(names[0], names[1], "field")
    differences += only_in_one(before.metadata, after.metadata, "metadata")
    differences += (
        f"metadata: {name}: {value} before, {after.metadata[name]} after"
        for name, value in before.metadata.items()
        if after.metadata.get(name, value) != value
    )
    return differences, equal


def main() -> int:
    """Compare the recordings, and print the differences."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    options = parser.parse_args()
    try:
        before, after = read(options.before), read(options.after)
    except (OSError, ValueError, McapError) as error:
        parser.error(f"no recording of a run can be read: {error}")
    differences, equal = compare(before, after)
    verdict = "equal" if equal else "NOT equal"
    print(
        "\n".join(
            [*differences, f"{len(before.cycles)} cycles: forces, commands, poses and verdicts are {verdict}"]
        )
    )
    return int(not equal)


if __name__ == "__main__":
    sys.exit(main())
