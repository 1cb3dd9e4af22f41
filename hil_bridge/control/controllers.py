"""Registry of controllers, built-in and from plug-ins, by the names that a configuration uses.

A plug-in provides a dataclass that satisfies `control.types.Controller`. Its fields are the parameters, and its
`name` is the name of the entry point. Measurements and commands are msgspec structs; `msgspec.structs.replace`
returns a modified copy.
"""

import dataclasses
import inspect
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, cast

from hil_bridge.control.laws.fuzzy_control import FuzzyAdaptive, FuzzyPi, ResolutionAware
from hil_bridge.control.laws.linear import Admittance, Pi
from hil_bridge.control.laws.policy import PolicyFile
from hil_bridge.control.laws.predictive import Predictive
from hil_bridge.control.types import SAMPLE_MS, Controller, Measurement, as_command
from hil_bridge.errors import ConfigError
from hil_bridge.errors.failures import failure, method_location, one_line, plugin_location
from hil_bridge.errors.plugins import Found, find_plugin, offers, plugin_names

GROUP = "hil_bridge.controllers"
"""Entry point group for controllers from plug-ins."""
CONTROLLERS: Mapping[str, Callable[..., Controller[Any]]] = MappingProxyType(
    {kind.name: kind for kind in (FuzzyPi, FuzzyAdaptive, ResolutionAware, Pi, Admittance, Predictive)}
)
"""Built-in controllers with default parameters, by the name that a configuration uses."""
OF_FILES: Mapping[str, Callable[..., Controller[Any]]] = MappingProxyType({PolicyFile.name: PolicyFile})
"""Built-in controllers whose control law is read from a file."""
OURS: Mapping[str, Callable[..., Controller[Any]]] = MappingProxyType({**CONTROLLERS, **OF_FILES})
"""All built-in controllers."""


def controller_names() -> list[str]:
    """Return the names of all controllers: the built-in ones first, then the ones from plug-ins."""
    return [*OURS, *plugin_names(GROUP)]


def controller_kind(name: str) -> Callable[..., Controller[Any]]:
    """Return the class of a built-in controller or of a plug-in's controller. Raises ConfigError if no package or
    more than one package provides the name, or if the package cannot be loaded.
    """
    entry = find_plugin(GROUP, "controller", name, OURS)
    if entry is not None:
        return _check(entry, name)
    if name not in OURS:
        raise ConfigError(f"there is no controller {name!r}; choose one of {', '.join(controller_names())}")
    return OURS[name]


def controller_package(name: str) -> str:
    """Return the package that provides a controller, with its version; empty for a built-in or unknown controller."""
    return next((package for offer, package, _ in offers(GROUP) if offer == name), "")


def make_controller(name: str, **parameters: Any) -> Controller[Any]:
    """Return a new controller by its name. Raises ConfigError for an unknown name or an unknown parameter."""
    kind = controller_kind(name)
    try:
        return kind(**parameters)
    except (TypeError, ValueError) as error:
        place = plugin_location(error)
        raise ConfigError(f"controller {name}: {one_line(str(error))}{place and f' ({place})'}") from error
    except (Exception, SystemExit) as error:
        raise ConfigError(f"controller {name} cannot be made: {failure(error)}") from error


def trial(name: str) -> str:
    """Return the error that a controller with default parameters raises for one sample; empty if it raises none.

    A controller with a required parameter is not tried. Raises ConfigError for the same reasons as
    `make_controller`.
    """
    missing = dataclasses.MISSING
    for field in dataclasses.fields(cast(Any, controller_kind(name))):
        if field.init and field.default is missing and field.default_factory is missing:
            return ""
    controller = make_controller(name)
    sample_time(controller)
    for field in dataclasses.fields(cast(Any, controller)):
        value = getattr(controller, field.name, None)
        if isinstance(value, float) and math.isnan(value):
            return f"its parameter {field.name} is nan by default"
    where = method_location(controller, "step")
    try:
        answer: Any = controller.step(controller.initial(), Measurement(0.0, 5.0, 1e-3, 1e-3), 10.0)
        if not (isinstance(answer, tuple) and len(answer) == 2):
            if inspect.iscoroutine(answer):
                answer.close()
            return f"its step returned {type(answer).__name__}, not a state and a command ({where})"
        command = as_command(answer[1])
    except (Exception, SystemExit) as error:
        return f"it fails at its first sample: {failure(error, where)}"
    if not (math.isfinite(command.position) and math.isfinite(command.correction)):
        return f"it commands {command.position} m at its first sample ({where})"
    return ""


PERIOD_FACTOR = 2.0
"""Largest ratio of a control period to a controller's sample time, in either direction. Chosen: half or double the
sample time changes the delay of a loop, but not by an order of magnitude.
"""


def sample_time(controller: Controller[Any], sample_ms: float | None = None) -> float:
    """Return the sample time that a controller is tuned for, s: `sample_ms` from the configuration, or the value
    that the controller declares, or `SAMPLE_MS`. Raises ConfigError if the declared value is not a number above 0.
    """
    if sample_ms is None:
        sample_ms = getattr(controller, "sample_ms", SAMPLE_MS)
    if isinstance(sample_ms, bool) or not isinstance(sample_ms, (int, float)):
        raise ConfigError(f"controller {controller.name}: its sample_ms is not a number: {sample_ms!r}")
    if not (math.isfinite(sample_ms) and sample_ms > 0):
        raise ConfigError(f"controller {controller.name}: its sample_ms must be above 0, got {sample_ms:g}")
    return sample_ms * 1e-3


def check_period(period_s: float | None, controller: Controller[Any], sample_ms: float | None = None) -> None:
    """Raise ConfigError if the control period, s, differs by more than `PERIOD_FACTOR` from the sample time that
    the controller is tuned for. `None` stands for a period that the link sets and that is unknown before the run.
    """
    tuned = sample_time(controller, sample_ms)
    if period_s is None or tuned / PERIOD_FACTOR <= period_s <= tuned * PERIOD_FACTOR:
        return
    raise ConfigError(
        f"controller {controller.name} is tuned for a sample every {tuned * 1e3:g} ms, but the control period is "
        f"{period_s * 1e3:g} ms: set controller.sample_ms = {period_s * 1e3:g} when its parameters fit that period, "
        f"or run.period_ms = {tuned * 1e3:g}"
    )


def _check(entry: Found, name: str) -> Callable[..., Controller[Any]]:
    kind, where = entry.value, f"{entry.where}: {entry.source}"
    if not (inspect.isclass(kind) and dataclasses.is_dataclass(kind)):
        raise ConfigError(f"{where} is not a dataclass")
    for method in ("initial", "step"):
        if not callable(getattr(kind, method, None)):
            raise ConfigError(f"{where} has no method {method}")
    if getattr(kind, "name", None) != name:
        raise ConfigError(f"{where} must have that as its attribute `name`")
    return cast(Callable[..., Controller[Any]], kind)
