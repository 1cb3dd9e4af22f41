"""Controllers by the names under which a configuration chooses them, ours and those of other packages.

A package offers a dataclass, its fields the parameters, that satisfies `control.types.Controller` and bears the entry
point's name as `name`. Measurements and commands are msgspec structs: `msgspec.structs.replace` makes changed ones.
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
from hil_bridge.errors.failures import failure, one_line, place_of_method, plugin_place
from hil_bridge.errors.plugins import Found, find_plugin, offers, plugin_names

GROUP = "hil_bridge.controllers"
"""Entry point group of other packages' controllers."""
CONTROLLERS: Mapping[str, Callable[..., Controller[Any]]] = MappingProxyType(
    {kind.name: kind for kind in (FuzzyPi, FuzzyAdaptive, ResolutionAware, Pi, Admittance, Predictive)}
)
"""Every controller of ours that has defaults, by the name under which a configuration chooses it."""
OF_FILES: Mapping[str, Callable[..., Controller[Any]]] = MappingProxyType({PolicyFile.name: PolicyFile})
"""Those whose law stands in a file."""
OURS: Mapping[str, Callable[..., Controller[Any]]] = MappingProxyType({**CONTROLLERS, **OF_FILES})
"""All of ours."""


def controller_names() -> list[str]:
    """Names of all controllers: ours, then those of other packages."""
    return [*OURS, *plugin_names(GROUP)]


def controller_kind(name: str) -> Callable[..., Controller[Any]]:
    """Our controller or that of a plug-in. Raises ConfigError for a name that no package or too many
    offer, and for a package that is broken.
    """
    found = find_plugin(GROUP, "controller", name, OURS)
    if found is not None:
        return _check(found, name)
    if name not in OURS:
        raise ConfigError(f"there is no controller {name!r}; choose one of {', '.join(controller_names())}")
    return OURS[name]


def controller_package(name: str) -> str:
    """Return the package that offers a controller, with its version; empty for a built-in and for an unknown one."""
    return next((package for offer, package, _ in offers(GROUP) if offer == name), "")


def make_controller(name: str, **parameters: Any) -> Controller[Any]:
    """Make a controller by its name. Raises ConfigError for an unknown name or a parameter that it does not
    take.
    """
    kind = controller_kind(name)
    try:
        return kind(**parameters)
    except (TypeError, ValueError) as error:
        place = plugin_place(error)
        raise ConfigError(f"controller {name}: {one_line(str(error))}{place and f' ({place})'}") from error
    except (Exception, SystemExit) as error:
        raise ConfigError(f"controller {name} cannot be made: {failure(error)}") from error


def trial(name: str) -> str:
    """Return the error of a controller made from its defaults and given one sample; empty if there is none.

    One with a parameter that must be given is not tried. Raises ConfigError as `make_controller`.
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
    where = place_of_method(controller, "step")
    try:
        answer: Any = controller.step(controller.initial(), Measurement(0.0, 5.0, 1e-3, 1e-3), 10.0)
        if not (isinstance(answer, tuple) and len(answer) == 2):
            if inspect.iscoroutine(answer):
                answer.close()
            return f"its step answers {type(answer).__name__}, not a state and a command ({where})"
        command = as_command(answer[1])
    except (Exception, SystemExit) as error:
        return f"it fails at its first sample: {failure(error, where)}"
    if not (math.isfinite(command.position) and math.isfinite(command.correction)):
        return f"it commands {command.position} m at its first sample ({where})"
    return ""


PERIOD_FACTOR = 2.0
"""How many times longer or shorter than a controller's sample time a control period may be. Chosen: half and double the
sample time change a loop's delay, but not by an order of magnitude.
"""


def sample_time(controller: Controller[Any], sample_ms: float | None = None) -> float:
    """Sample time that a controller is tuned for, s: `sample_ms` where a configuration gives it, else what the
    controller declares, else `SAMPLE_MS`. Raises ConfigError when it declares no number above 0.
    """
    if sample_ms is None:
        sample_ms = getattr(controller, "sample_ms", SAMPLE_MS)
    if isinstance(sample_ms, bool) or not isinstance(sample_ms, (int, float)):
        raise ConfigError(f"controller {controller.name}: its sample_ms is not a number: {sample_ms!r}")
    if not (math.isfinite(sample_ms) and sample_ms > 0):
        raise ConfigError(f"controller {controller.name}: its sample_ms must be above 0, got {sample_ms:g}")
    return sample_ms * 1e-3


def check_period(period_s: float | None, controller: Controller[Any], sample_ms: float | None = None) -> None:
    """Raise ConfigError when the control period, s, is off by more than `PERIOD_FACTOR` from the sample time that the
    controller is tuned for. None for a period that is not known before the run: the link sets it.
    """
    tuned = sample_time(controller, sample_ms)
    if period_s is None or tuned / PERIOD_FACTOR <= period_s <= tuned * PERIOD_FACTOR:
        return
    raise ConfigError(
        f"controller {controller.name} is tuned for a sample every {tuned * 1e3:g} ms, but the control period is "
        f"{period_s * 1e3:g} ms: set controller.sample_ms = {period_s * 1e3:g} when its parameters fit that period, "
        f"or run.period_ms = {tuned * 1e3:g}"
    )


def _check(found: Found, name: str) -> Callable[..., Controller[Any]]:
    kind, where = found.value, f"{found.where}: {found.source}"
    if not (inspect.isclass(kind) and dataclasses.is_dataclass(kind)):
        raise ConfigError(f"{where} is no dataclass")
    for method in ("initial", "step"):
        if not callable(getattr(kind, method, None)):
            raise ConfigError(f"{where} has no method {method}")
    if getattr(kind, "name", None) != name:
        raise ConfigError(f"{where} must bear that as its attribute `name`")
    return cast(Callable[..., Controller[Any]], kind)
