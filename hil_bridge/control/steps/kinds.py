"""The kinds of steps by their words: those of this project, and those of other packages."""

import dataclasses
import inspect
from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, TypeAlias, cast

from pydantic import (
    Discriminator,
    SerializeAsAny,
    TypeAdapter,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import InitErrorDetails

from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.hold import Hold
from hil_bridge.control.steps.move import Move
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import Step
from hil_bridge.control.steps.seek import Seek
from hil_bridge.control.steps.track import Track
from hil_bridge.control.steps.zero import Zero
from hil_bridge.errors import ConfigError
from hil_bridge.errors.plugins import find_plugin, plugin_names

GROUP = "hil_bridge.steps"
"""Entry points of steps of other packages."""
BUILT_IN: Mapping[str, type[Step]] = {
    "approach": Approach,
    "track": Track,
    "hold": Hold,
    "seek": Seek,
    "retract": Retract,
    "move": Move,
    "zero": Zero,
}


def step_words() -> list[str]:
    """Words of all steps."""
    return [*BUILT_IN, *(name for name in plugin_names(GROUP) if name not in BUILT_IN)]


@cache
def step_kind(word: str) -> type[Step] | None:
    """The kind of this word; None for an unknown one. Raises ConfigError for a plug-in that cannot be loaded, or that
    is no step.
    """
    if word in BUILT_IN:
        return BUILT_IN[word]
    found = find_plugin(GROUP, "step", word, BUILT_IN)
    if found is None:
        return None
    kind, where = found.value, f"{found.where}: {found.source}"
    if not _is_kind(kind):
        raise ConfigError(f"{where} is no dataclass that derives from Step")
    fields = {field.name: field for field in dataclasses.fields(kind)}
    if "do" not in fields or fields["do"].default != word:
        raise ConfigError(f"{where} must bear the word {word!r} as the default of its field `do`")
    return cast(type[Step], kind)


def _is_kind(kind: Any) -> bool:
    return inspect.isclass(kind) and issubclass(kind, Step) and dataclasses.is_dataclass(kind)


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def read_step(value: Any, read_built_in: ValidatorFunctionWrapHandler) -> Any:
    """A step from its settings. A kind of another package is no part of the built-in union, and is read by itself."""
    if isinstance(value, Step):
        return value
    word = value.get("do") if isinstance(value, Mapping) else None
    kind = step_kind(word) if isinstance(word, str) and word not in BUILT_IN else None
    if kind is None:
        return read_built_in(value)
    try:
        return _adapter(cast(Any, kind)).validate_python(value)
    except ValidationError as error:
        raise ValidationError.from_exception_data(kind.__name__, _below(word, error)) from error


def _below(word: str | None, error: ValidationError) -> list[InitErrorDetails]:
    """Faults of a step's settings, with its word in their place, as those of the built-in ones have it."""
    return [
        InitErrorDetails(
            type=fault["type"],
            loc=(word or "", *fault["loc"]),
            input=fault["input"],
            ctx=fault.get("ctx", {}),
        )
        for fault in error.errors(include_url=False)
    ]


SimpleStep: TypeAlias = SerializeAsAny[
    Annotated[
        Annotated[Approach | Track | Hold | Seek | Retract | Move | Zero, Discriminator("do")],
        WrapValidator(read_step),
    ]
]
"""A step that holds no others, by its word."""
