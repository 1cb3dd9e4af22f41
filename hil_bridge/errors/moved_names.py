"""Renamed names in the API for plug-ins, and the locations at which a plug-in still uses the old names.

The error message about a plug-in that cannot be loaded, or whose step has methods of an earlier version, lists all
of them.
"""

import ast
import importlib.util
from collections.abc import Iterator, Mapping
from pathlib import Path

SINCE = "0.7"
"""Version in which the names in this table changed."""
_CONTROL = "hil_bridge.control"
_DEVICES = "hil_bridge.devices"
MOVED: Mapping[str, str] = {
    f"{_CONTROL}.program.state.Felt": f"{_CONTROL}.course.contact_sample.ContactSample",
    f"{_CONTROL}.program.state.ProgramState": f"{_CONTROL}.course.state.StepState (what a step answers) and Course",
    f"{_CONTROL}.program.state.Tally": f"{_CONTROL}.course.state.Tally",
    f"{_CONTROL}.program.state.Done": f"{_CONTROL}.course.state.Done",
    f"{_CONTROL}.program.leg.Leg": f"{_CONTROL}.steps.plan.StepPlan",
    f"{_CONTROL}.program.facing.Facing": f"{_CONTROL}.course.facing.Facing",
    f"{_CONTROL}.program.felt.WorkFrame": f"{_CONTROL}.geometry.work_frame.WorkFrame",
    f"{_CONTROL}.program.outcome.ROUNDING": f"{_CONTROL}.geometry.ways.ROUNDING",
    f"{_CONTROL}.program.yielding.yield_to": f"{_CONTROL}.course.yielding.yield_to",
    f"{_CONTROL}.steps.seam.Taken": f"{_CONTROL}.steps.seam.StepResult",
    f"{_CONTROL}.steps.pressing.Led": f"{_CONTROL}.steps.pressing.PathPoint",
    f"{_CONTROL}.steps.paths.Place": f"{_CONTROL}.geometry.ways.Place",
    f"{_CONTROL}.steps.paths.Way": f"{_CONTROL}.geometry.ways.Way",
    f"{_CONTROL}.steps.paths.way_of": f"{_CONTROL}.geometry.ways.way_of",
    f"{_DEVICES}.playing.Course": f"{_DEVICES}.trajectory.Trajectory",
    f"{_DEVICES}.playing.Played": f"{_DEVICES}.trajectory.TrajectoryResult",
    f"{_DEVICES}.playing.play_stream": f"{_DEVICES}.trajectory.stream_trajectory",
    f"{_DEVICES}.robots.asked.Asking": f"{_DEVICES}.robots.request_channel.RequestChannel",
    f"{_DEVICES}.robots.probing.Probed": f"{_DEVICES}.robots.probe.ProbeResult",
    f"{_DEVICES}.robots.probing.probe_link": f"{_DEVICES}.robots.probe.probe_link",
}
"""New names, by the old name."""
METHODS: Mapping[str, tuple[str, str]] = {
    "take": ("leg, state, felt", "context, state"),
    "is_over": ("leg, state, felt", "context, state"),
    "guide": ("leg, state, felt", "context, state"),
    "lead": ("leg, state, stroke, order, felt", "context, state, stroke, order"),
    "end_sample": ("leg, before, taken, felt", "context, before, result"),
}
"""Parameters of a step's methods, by method: the old and the new ones."""
PLACES_LIMIT = 12
"""Maximum number of locations in one message. Chosen."""
_FILES_MOST, _FILE_BYTES = 200, 1_000_000
"""Maximum number and size of the files that are parsed. Chosen: parsing an unusual package must not take long."""


def old_names(module: str) -> str:
    """Return the uses of old names in a package, with the new names, in one line; empty if there are none.

    `module` is a module of the package. The files of the package are parsed, not imported.
    """
    uses = [text for path in _sources(module) for text in _in_file(path)]
    more = f"; and {len(uses) - PLACES_LIMIT} more" if len(uses) > PLACES_LIMIT else ""
    return "; ".join(uses[:PLACES_LIMIT]) + more


def _sources(module: str) -> Iterator[Path]:
    try:
        spec = importlib.util.find_spec(module.partition(".")[0])
    except (ImportError, ValueError):
        return
    if spec is None:
        return
    for folder in spec.submodule_search_locations or ():
        yield from sorted(Path(folder).rglob("*.py"))[:_FILES_MOST]
    if not spec.submodule_search_locations and spec.origin:
        yield Path(spec.origin)


def _in_file(path: Path) -> Iterator[str]:
    try:
        if path.stat().st_size > _FILE_BYTES:
            return
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError):
        return
    for node in ast.walk(tree):
        where = f"{path.parent.name}/{path.name}:{getattr(node, 'lineno', 0)}"
        if isinstance(node, ast.ImportFrom):
            for name in node.names:
                if (new := MOVED.get(f"{node.module}.{name.name}")) is not None:
                    yield f"{where}: {name.name} is now {new}"
        elif isinstance(node, ast.FunctionDef) and node.name in METHODS:
            old, new = METHODS[node.name]
            names = [each.arg for each in node.args.args]
            if names[:1] == ["self"] and len(names) == old.count(",") + 2:
                yield f"{where}: {node.name}({old}) is now {node.name}({new})"
