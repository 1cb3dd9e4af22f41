"""Configuration passed by a program: a file, tables or a configuration, with overrides."""

import dataclasses
from collections.abc import Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import PrivateAttr, ValidationError

from hil_bridge.control.types import Controller, Tuning
from hil_bridge.errors import ConfigError
from hil_bridge.settings.configuration import Config, ControllerConfig, explain, read_config, read_values
from hil_bridge.settings.program import with_program

Source: TypeAlias = Config | Mapping[str, Any] | Path | str | None
"""Source of a configuration: a configuration, its tables, the path of its file, or nothing for the defaults."""
_PLAIN = (bool, int, float, str)
"""Types of parameters that a recording can hold."""


class GivenController(ControllerConfig):
    """Controller passed as an object. The recording has its name and its plain parameters."""

    _controller: Controller[Any] = PrivateAttr()

    @property
    def controller(self) -> Controller[Any]:
        """Controller object."""
        return self._controller

    def tuned(self, tuning: Tuning) -> "GivenController":
        """Return a copy with a tuning that the controller declares. A parameter is tuned only if it still has its
        default.
        """
        controller: Any = self._controller
        if not dataclasses.is_dataclass(controller) or isinstance(controller, type):
            return self.model_copy(update={"sample_ms": tuning.sample_ms})
        defaults = {
            field.name: field.default
            for field in dataclasses.fields(controller)
            if field.init and field.default == getattr(controller, field.name)
        }
        changed = {name: value for name, value in tuning.parameters.items() if name in defaults}
        if changed:
            controller = dataclasses.replace(controller, **changed)
        section = self.model_copy(
            update={"sample_ms": tuning.sample_ms, "parameters": _parameters(controller)}
        )
        section._controller = controller
        return section


def config_of(
    source: Source,
    faults: Sequence[Mapping[str, Any]] = (),
    controller: Controller[Any] | str | None = None,
    seed: int | None = None,
) -> Config:
    """Return the configuration of a run.

    `faults` holds tables as in [[faults]], which are added after the faults of the source. Raises ConfigError with
    the key and what to do.
    """
    path = Path(source) if isinstance(source, (str, Path)) else None
    name = controller if isinstance(controller, str) else None
    if isinstance(source, Config) and not faults and name is None and seed is None:
        config = source
    else:
        values = _values(source, path)
        if faults:
            values["faults"] = [*values.get("faults", ()), *map(dict, faults)]
        if name is not None:
            _table(values, "controller")["name"] = name
        if seed is not None:
            _table(values, "run")["seed"] = seed
        is_complete = isinstance(source, Config)  # it already contains the steps of its program
        sources = {} if is_complete else with_program(values, str(path or "configuration"))
        try:
            config = read_config(values)
        except ValidationError as error:
            raise explain(error, path, set(), sources) from error
    if controller is None or name is not None:
        return config
    return config.model_copy(update={"controller": _wrap_controller(config, controller)})


def _values(source: Source, path: Path | None) -> dict[str, Any]:
    if path is not None:
        return read_values(path)
    match source:
        case Config():
            return source.model_dump(mode="json")
        case Mapping():
            return deepcopy(dict(source))
        case _:
            return {}


def _table(values: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a table from the values. An invalid table is replaced by an empty one."""
    table = values.setdefault(name, {})
    return table if isinstance(table, dict) else {}


def _wrap_controller(config: Config, controller: Any) -> GivenController:
    """Return the section with the controller object. Raises ConfigError for an object that is not a controller."""
    if isinstance(controller, type):
        raise ConfigError(
            f"controller: {controller.__name__} is a class; give an instance, {controller.__name__}(…), or its name"
        )
    for method in ("initial", "step"):
        if not callable(getattr(controller, method, None)):
            raise ConfigError(f"controller: {controller!r} has no method {method}")
    name = getattr(controller, "name", None)
    if not isinstance(name, str) or not name:
        raise ConfigError(f"controller: {controller!r} has no name")
    given = GivenController.model_construct(
        name=name, parameters=_parameters(controller), sample_ms=config.controller.sample_ms
    )
    given._controller = controller
    return given


def _parameters(controller: Any) -> dict[str, Any]:
    """Return the plain parameters of a controller that is a dataclass, for the recording."""
    if not dataclasses.is_dataclass(controller):
        return {}
    values = {
        field.name: getattr(controller, field.name) for field in dataclasses.fields(controller) if field.init
    }
    return {name: value for name, value in values.items() if isinstance(value, _PLAIN)}
