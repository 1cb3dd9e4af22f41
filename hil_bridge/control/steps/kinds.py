"""The kinds of steps by their words: those of this project, and those of other packages."""

import dataclasses
import inspect
import math
from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, TypeAlias, cast

from pydantic import (
    Discriminator,
    PydanticUserError,
    SerializeAsAny,
    TypeAdapter,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import InitErrorDetails

from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.hold import Hold
from hil_bridge.control.steps.led import LedStep, StepSample
from hil_bridge.control.steps.move import Move
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import Step
from hil_bridge.control.steps.seek import Seek
from hil_bridge.control.steps.track import Track
from hil_bridge.control.steps.zero import Zero
from hil_bridge.errors import ConfigError
from hil_bridge.errors.failures import failure, one_line, place_of_method
from hil_bridge.errors.moved_names import METHODS
from hil_bridge.errors.plugins import find_plugin, offers, plugin_names, refuse_old_names

GROUP = "hil_bridge.steps"
"""Entry points of steps of other packages."""
FIRST_SAMPLE = StepSample(
    s=0.0,
    dt=0.18,
    force=(5.0, 0.0, 0.0),
    moment=(0.0, 0.0, 0.0),
    place=(0.0, 0.0),
    depth=0.0,
    in_contact=True,
    force_n=10.0,
)
"""A first sample: pressed with half the wanted force."""
BUILT_IN: Mapping[str, type[Step]] = {
    "approach": Approach,
    "track": Track,
    "hold": Hold,
    "seek": Seek,
    "retract": Retract,
    "move": Move,
    "zero": Zero,
}
TAKEN = (*BUILT_IN, "repeat")
"""Words that no other package may offer."""


def step_words() -> list[str]:
    """Words of all steps."""
    return [*BUILT_IN, *(name for name in plugin_names(GROUP) if name not in TAKEN)]


def step_package(word: str) -> str:
    """Return the package that offers a step, with its version; empty for a built-in and for an unknown one."""
    return next((package for offer, package, _ in offers(GROUP) if offer == word), "")


def step_kind(word: str) -> type[Step] | None:
    """Return the kind of this name; None for an unknown one.

    Raises ConfigError for a plug-in that cannot be loaded, or that is no step.
    """
    found = find_plugin(GROUP, "step", word, TAKEN)
    if found is None:
        return BUILT_IN.get(word)
    kind, where = found.value, f"{found.where}: {found.source}"
    if not _is_kind(kind):
        raise ConfigError(f"{where} is no frozen dataclass that derives from Step")
    if any(_has_old_parameters(kind, method) for method in METHODS):
        refuse_old_names(where, kind.__module__)
    fields = {field.name: field for field in dataclasses.fields(kind)}
    if "do" not in fields or fields["do"].default != word:
        raise ConfigError(f"{where} must bear the word {word!r} as the default of its field `do`")
    for field in fields.values():
        if isinstance(field.default, property):
            raise ConfigError(
                f"{where} has no default for {field.name}, and takes a property of Step for one: write "
                f"`{field.name}: … = field()`"
            )
    try:
        _adapter(kind)
    except (PydanticUserError, NameError) as error:
        raise ConfigError(f"{where} has a setting that no file can hold: {one_line(str(error))}") from error
    return cast(type[Step], kind)


def trial(word: str) -> str:
    """Return the error of a step made from its defaults and given one sample; empty if there is none.

    One with a setting that must be given is not tried. Raises ConfigError as `step_kind`.
    """
    kind: Any = step_kind(word)
    missing = dataclasses.MISSING
    if any(field.default is field.default_factory is missing for field in dataclasses.fields(kind)):
        return ""
    try:
        step = kind()
    except (Exception, SystemExit) as error:
        return f"it cannot be made from its defaults: {failure(error)}"
    if not isinstance(step, LedStep):
        return ""
    where = place_of_method(step, "steer")
    try:
        _, lead = step.answer(step.begin(), FIRST_SAMPLE)
    except (Exception, SystemExit) as error:
        return f"it fails at its first sample: {failure(error, where)}"
    if not math.isfinite(sum(lead.to)):
        return f"it leads to {lead.to} m at its first sample ({where})"
    return ""


def _has_old_parameters(kind: Any, method: str) -> bool:
    """Whether a kind has a method of an earlier version, by the number of its parameters."""
    own = getattr(kind, method, None)
    return (
        inspect.isfunction(own)
        and len(inspect.signature(own).parameters) == METHODS[method][0].count(",") + 2
    )


def _is_kind(kind: Any) -> bool:
    if not (inspect.isclass(kind) and issubclass(kind, Step) and "__dataclass_params__" in vars(kind)):
        return False
    return bool(vars(kind)["__dataclass_params__"].frozen)


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    adapter = TypeAdapter(kind)
    adapter.rebuild(raise_errors=True)  # a name in its annotations that is none
    return adapter


def read_step(value: Any, read_built_in: ValidatorFunctionWrapHandler) -> Any:
    """Read a step from its settings. A plug-in's kind is not in the built-in union, and is read by itself."""
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
