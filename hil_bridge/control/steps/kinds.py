"""Registry of step kinds by their words: built-in kinds and the kinds of plug-ins."""

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
from hil_bridge.errors.failures import failure, method_location, one_line
from hil_bridge.errors.moved_names import METHODS
from hil_bridge.errors.plugins import find_plugin, offers, plugin_names, refuse_old_names

GROUP = "hil_bridge.steps"
"""Entry point group for steps from plug-ins."""
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
"""Example of a first sample, with half the desired force."""
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
"""Words that plug-ins may not use."""


def step_words() -> list[str]:
    """Return the words of all steps."""
    return [*BUILT_IN, *(name for name in plugin_names(GROUP) if name not in TAKEN)]


def step_package(word: str) -> str:
    """Return the package that provides a step, with its version; empty for a built-in or unknown step."""
    return next((package for offer, package, _ in offers(GROUP) if offer == word), "")


def step_kind(word: str) -> type[Step] | None:
    """Return the step kind with the given word; None if it is unknown.

    Raises ConfigError for a plug-in that cannot be loaded, or that does not provide a step.
    """
    entry = find_plugin(GROUP, "step", word, TAKEN)
    if entry is None:
        return BUILT_IN.get(word)
    kind, where = entry.value, f"{entry.where}: {entry.source}"
    if not _is_kind(kind):
        raise ConfigError(f"{where} is not a frozen dataclass that derives from Step")
    if any(_has_old_parameters(kind, method) for method in METHODS):
        refuse_old_names(where, kind.__module__)
    fields = {field.name: field for field in dataclasses.fields(kind)}
    if "do" not in fields or fields["do"].default != word:
        raise ConfigError(f"{where} must have the word {word!r} as the default of its field `do`")
    for field in fields.values():
        if isinstance(field.default, property):
            raise ConfigError(
                f"{where} has no default for {field.name}, and uses a property of Step as one: write "
                f"`{field.name}: … = field()`"
            )
    try:
        _adapter(kind)
    except (PydanticUserError, NameError) as error:
        raise ConfigError(
            f"{where} has a setting that no file can contain: {one_line(str(error))}"
        ) from error
    return cast(type[Step], kind)


def trial(word: str) -> str:
    """Return the error of a step with default settings for one sample; empty if there is none.

    A step with a required setting is not tried. Raises ConfigError for the same reasons as `step_kind`.
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
    where = method_location(step, "steer")
    try:
        _, lead = step.answer(step.begin(), FIRST_SAMPLE)
    except (Exception, SystemExit) as error:
        return f"it fails at its first sample: {failure(error, where)}"
    if not math.isfinite(sum(lead.to)):
        return f"it leads to {lead.to} m at its first sample ({where})"
    return ""


def _has_old_parameters(kind: Any, method: str) -> bool:
    """Return whether a kind has a method of an earlier version, which has a different number of parameters."""
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
    adapter.rebuild(raise_errors=True)  # raises for an undefined name in its annotations
    return adapter


def read_step(value: Any, read_built_in: ValidatorFunctionWrapHandler) -> Any:
    """Return a step from its settings. The kind of a plug-in is not in the built-in union, so it is read separately."""
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
    """Report errors in a step's settings under the step's word, as for built-in steps."""
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
"""Step that contains no other steps, by its word."""
