"""Tables of docs/reference/tasks.md: the words and paths of a program with all their settings.

With --measure the pictures of the examples are drawn again.
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
"""Settings of the task that stand for a setting of a step that is not given, by the step's word and setting."""
MEANINGS: Mapping[str, str] = {
    "path": "Where the tool goes; see the paths below.",
    "orientation": "`fixed`: as at the start. `along-path`: turned about the approach so that it looks along the path. "
    "`normal`: perpendicular to the surface. `led`: tipped along the travel by a controller that does that.",
    "criterion": "How good the step must have been; see below.",
    "limits": "Limits of this step; see below.",
    "speed_mm_s": "Speed.",
    "step": "The steps, a table `[[task.step.step]]` each; no `repeat` among them.",
    "track.force_n": "Wanted force, or pairs of way in mm and force in N with straight ramps between.",
    "hold.force_n": "Wanted force.",
    "hold.for_s": "How long it presses.",
    "approach.contact_n": "Force that counts as contact.",
    "approach.at_most_mm": "How deep it goes at most; the run ends where it finds nothing. "
    "By default the way that the tool came back before counts too.",
    "seek.at_most_mm": "How far it goes at most; the run ends where it finds nothing.",
    "seek.speed_mm_s": "Speed.",
}
"""Meaning of settings that have no text at their own place, by setting, or by word and setting."""
HIDDEN = ("do", "kind"), ("repeat.limits",)
"""Settings that are told otherwise, and such as may not be given."""
TASK_SETTINGS = ("file", "safe_height_mm", "force_n", "expected_stiffness_n_m")
FRAME_SETTINGS = ("approach", "travel", "origin_mm", "follow_normal")


def measure(names: Sequence[str]) -> None:
    """Draw the pictures of these examples, of all where none is named."""
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
    """Meaning of a word, a path or another section, and its settings."""
    meaning = "" if section in (Criterion, Facing) else f"{_one_line(inspect.getdoc(section) or '')}\n\n"
    return meaning + rows_table(_fields(word, section))


def limits_table() -> str:
    """Return the limits that a step can have of its own, with those of the run that they tighten."""
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
    """Name, default and meaning of each setting. Raises ValueError for one without a meaning."""
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
            raise ValueError(f"the page cannot tell what {word}.{field.name} means: give it a docstring")
        choices = _choices(types[field.name])
        if choices and f"`{choices[0]}`" not in meaning:
            meaning = f"{' or '.join(f'`{choice}`' for choice in choices)}. {meaning}"
        yield f"`{field.name}`", _default(word, field), meaning


def _default(word: str, field: Any) -> str:
    """Return the default in words."""
    if (stands := OF_THE_TASK.get((word, field.name))) is not None:
        return f"`task.{stands}`, {_value(getattr(TaskParameters(), stands))}"
    if field.default is dataclasses.MISSING:
        return "must be given"
    return _value(field.default)


def _value(value: object) -> str:
    """Return a default as a file would have it."""
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
    """Return the words that a setting may have; empty for one that is no word of a few."""
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    if get_origin(annotation) in (Union, UnionType):
        return next((found for part in get_args(annotation) if (found := _choices(part))), ())
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
