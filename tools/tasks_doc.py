"""Tables of docs/reference/tasks.md: the steps and paths of a program with all their settings.

With --measure, the pictures of the examples are redrawn.
"""

import dataclasses
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from hil_bridge.control import Limits, TaskParameters
from hil_bridge.control.course.facing import Facing
from hil_bridge.control.steps.seam import Criterion, StepLimits
from hil_bridge.record.field_docstrings import field_docstrings
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import FrameConfig, load_config
from hil_bridge.settings.program import PATHS, STEPS
from hil_bridge.show.report.task_plot import draw_task
from hil_bridge.show.report.task_steps import list_steps, total_line
from tools.pages import table

ROOT = Path(__file__).resolve().parent.parent
DOCS, EXAMPLES = ROOT / "docs", ROOT / "examples" / "tasks"

OF_THE_TASK: Mapping[tuple[str, str], str] = {
    ("approach", "speed_mm_s"): "approach_speed_mm_s",
    ("approach", "contact_n"): "contact_threshold_n",
    ("approach", "at_most_mm"): "approach_depth_limit_mm",
    ("track", "speed_mm_s"): "speed_mm_s",
    ("track", "force_n"): "force_n",
    ("hold", "force_n"): "force_n",
    ("seek", "speed_mm_s"): "approach_speed_mm_s",
    ("seek", "contact_n"): "contact_threshold_n",
    ("retract", "back_mm"): "retract_mm",
    ("retract", "speed_mm_s"): "retract_speed_mm_s",
    ("move", "contact_n"): "contact_threshold_n",
}
"""Settings of the task that are the default of a step's setting, by the names of the step and of its setting."""
MEANINGS: Mapping[str, str] = {
    "path": "Path of the tool; see the paths below.",
    "orientation": "`fixed`: as at the start. `along-path`: turned about the approach to face along the path. "
    "`normal`: perpendicular to the surface. `led`: tipped along the travel by a controller that supports it.",
    "criterion": "Quality that the step must reach; see below.",
    "limits": "Limits of this step; see below.",
    "speed_mm_s": "Speed.",
    "step": "The steps, a table `[[task.step.step]]` each; no `repeat` among them.",
    "track.force_n": "Target force, or pairs of distance in mm and force in N with linear ramps in between.",
    "hold.force_n": "Target force.",
    "hold.for_s": "Duration of the contact.",
    "approach.contact_n": "Force that counts as contact.",
    "approach.at_most_mm": "Maximum depth; the run ends if there is no contact. "
    "By default, the distance of the preceding retraction is added.",
    "seek.at_most_mm": "Maximum distance; the run ends if there is no contact.",
    "seek.speed_mm_s": "Speed.",
}
"""Descriptions of settings that have no docstring, by setting, or by step and setting."""
HIDDEN = ("do", "kind"), ("repeat.limits",)
"""Settings that are described elsewhere, or that a program may not set."""
TASK_SETTINGS = ("file", "safe_height_mm", "force_n", "expected_stiffness_n_m")
FRAME_SETTINGS = ("approach", "travel", "origin_mm", "follow_normal")


def measure(names: Sequence[str]) -> None:
    """Draw the pictures of these examples, or of all examples if none is named."""
    for path in sorted(EXAMPLES.glob("*.toml")):
        if not names or path.stem in names:
            (DOCS / "pictures" / f"task-{path.stem}.png").write_bytes(picture(path))


def picture(path: Path) -> bytes:
    """Return the picture of an example."""
    config = load_config(path, {})
    row: Any = Setup(config).loop.program.row
    steps = list_steps(config.task.step, row)
    return draw_task(steps, f"{path.stem}: {total_line(steps, row)}")


# --- tables


def section_table(word: str, section: Any) -> str:
    """Return the description of a step, a path or another section, and its settings."""
    meaning = "" if section in (Criterion, Facing) else f"{_one_line(inspect.getdoc(section) or '')}\n\n"
    return meaning + rows_table(_fields(word, section))


def limits_table() -> str:
    """Return the table of the limits that a step can set, with the limits of the run that they tighten."""
    meanings, run = field_docstrings(Limits), Limits()
    rows = (
        (
            f"`{field.name}`",
            f"`limits.{field.name}`, {_value(getattr(run, field.name))}",
            meanings[field.name],
        )
        for field in dataclasses.fields(StepLimits)
    )
    return rows_table(rows)


def frame_table() -> str:
    """Return the settings of the frame that a program uses."""
    meanings, frame = field_docstrings(FrameConfig), FrameConfig()
    return rows_table((f"`{name}`", _value(getattr(frame, name)), meanings[name]) for name in FRAME_SETTINGS)


def rows_table(rows: Any) -> str:
    return table(["setting", "default", "meaning"], rows)


def _fields(word: str, section: Any, names: tuple[str, ...] = ()) -> Iterator[tuple[str, str, str]]:
    """Yield name, default and description of each setting. Raises ValueError if a setting has no description."""
    meanings, types = field_docstrings(section), inspect.get_annotations(section, eval_str=True)
    for field in dataclasses.fields(section):
        if (
            field.name in HIDDEN[0]
            or f"{word}.{field.name}" in HIDDEN[1]
            or (names and field.name not in names)
        ):
            continue
        own = MEANINGS.get(f"{word}.{field.name}") or meanings.get(field.name)
        meaning = own or MEANINGS.get(field.name, "")
        if not meaning:
            raise ValueError(f"no description of {word}.{field.name}: give it a docstring")
        choices = _choices(types[field.name])
        if choices and f"`{choices[0]}`" not in meaning:
            meaning = f"{' or '.join(f'`{choice}`' for choice in choices)}. {meaning}"
        yield f"`{field.name}`", _default(word, field), meaning


def _default(word: str, field: Any) -> str:
    """Return the default as text."""
    if (default := OF_THE_TASK.get((word, field.name))) is not None:
        return f"`task.{default}`, {_value(getattr(TaskParameters(), default))}"
    if field.default is dataclasses.MISSING:
        return "must be given"
    return _value(field.default)


def _value(value: object) -> str:
    """Return a default in the form in which a file contains it."""
    match value:
        case None | "" | () | StepLimits():
            return "none"
        case bool():
            return str(value).lower()
        case str():
            return f'`"{value}"`'
        case tuple():
            return f"`[{', '.join(f'{part:g}' for part in value)}]`"
        case _:
            return f"{value:g}"


def _choices(annotation: Any) -> tuple[str, ...]:
    """Return the allowed values of a setting if they are fixed; otherwise an empty string."""
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    if get_origin(annotation) in (Union, UnionType):
        return next((choices for part in get_args(annotation) if (choices := _choices(part))), ())
    return ()


def _one_line(text: str) -> str:
    return " ".join(text.split())


TABLES: Mapping[str, Callable[[], str]] = {
    **{word: partial(section_table, word, step) for word, step in STEPS.items()},
    **{f"path {kind}": partial(section_table, kind, path) for kind, path in PATHS.items()},
    "criterion": partial(section_table, "criterion", Criterion),
    "limits": limits_table,
    "task": lambda: rows_table(_fields("task", TaskParameters, TASK_SETTINGS)),
    "frame": frame_table,
    "facing": partial(section_table, "facing", Facing),
}
