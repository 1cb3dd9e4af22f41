"""Replay of a recording's decisions: the same controller and supervisor must give the same commands, bit for bit.

With another controller or other limits, a replay shows the commands that they would have given. Each cycle starts
from the recorded previous command, because the measurements depend on it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msgspec.structs import replace
from pydantic import ValidationError

from hil_bridge.control import Decision
from hil_bridge.control.controllers import controller_names
from hil_bridge.control.steps.kinds import step_words
from hil_bridge.control.types import Controller
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import parse_json
from hil_bridge.record import CycleRecord, Recording
from hil_bridge.runs.run_log import PACKAGE_NAME, STEP_PACKAGES
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config, explain, read_config, read_values
from hil_bridge.settings.given import config_of
from hil_bridge.settings.program import with_program
from protocol.geometry import Vector


@dataclass(frozen=True, slots=True)
class ReplayedCycle:
    """Recorded cycle and its replay."""

    record: CycleRecord
    decision: Decision

    @property
    def differences(self) -> dict[str, tuple[object, object]]:
        """Differences by name, as pairs of the recorded and the replayed value."""
        record, decision = self.record, self.decision
        pairs: dict[str, tuple[object, object]] = {
            "target": (record.target, decision.position),
            "phase": (record.phase, str(decision.intent.phase)),
            "depth_commanded": (record.depth_commanded, decision.target.depth),
            "travel_commanded": (record.travel_commanded, decision.target.travel),
            "across_commanded": (record.across_commanded, decision.target.across),
            "quaternion_commanded": (record.quaternion_commanded, decision.quaternion or ()),
            "verdict": (record.verdict, str(decision.verdict.kind)),
            "reasons": (record.reasons, decision.reasons),
        }
        return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def recorded_config(
    recording: Recording, changes: Mapping[str, Any], controller: Controller[Any] | None = None
) -> Config:
    """Return the configuration of a recorded run, overlaid with the given tables.

    `controller` replaces a controller that a program passed as an object, because the recording contains only its
    name. Raises ConfigError if the recording contains no configuration of this version, if its controller is not
    installed here, or if a change is invalid.
    """
    try:
        recorded = parse_json(recording.metadata.get("config", ""))
    except ValueError as error:
        raise ConfigError("the recording contains no configuration: it cannot be replayed") from error
    if not isinstance(recorded, dict):
        raise ConfigError("the recording contains no configuration: it cannot be replayed")
    named, other = recorded.get("controller"), False
    name = named.get("name") if isinstance(named, dict) else None
    if controller is not None and isinstance(named, dict):
        recorded["controller"] = {"sample_ms": named.get("sample_ms")}
    match changes.get("controller"):
        case {"name": new_name} if new_name != name:
            recorded["controller"], other = {}, True  # the parameters belong to the recorded controller
    _check_controller(recorded, recording.metadata.get(PACKAGE_NAME, ""))
    _check_steps(recorded, recording.metadata.get(STEP_PACKAGES, "{}"))
    try:
        values = read_config(recorded).model_dump(mode="json")
    except ValidationError as error:
        raise ConfigError(
            f"the recording's configuration is not one of this version: {explain(error, None, set())}"
        ) from error
    if other:
        values["controller"] = {}
    try:
        config = read_config(_merge(values, changes))
        if controller is not None:
            return config_of(config, controller=controller)
        return Setup(config).config if other else config
    except ValidationError as error:
        raise explain(error, None, set()) from error


def _check_controller(recorded: Mapping[str, Any], package: str) -> None:
    """Raise ConfigError for a controller that is not installed here. `package` is the package that provided it when
    the run was recorded.
    """
    section = recorded.get("controller")
    name = section.get("name") if isinstance(section, dict) else None
    if isinstance(name, str) and name not in controller_names():
        raise ConfigError(
            f"the recording was made with the controller {name[:80]!r}, which is not installed here: install "
            f"{package[:80] or 'the package that provides it'}, or choose another by "
            "`hil-bridge replay --controller NAME`"
        )


def _check_steps(recorded: Mapping[str, Any], packages: str) -> None:
    """Raise ConfigError for a step that is not installed here. `packages` holds the packages that provided the
    steps when the run was recorded, as JSON.
    """
    unknown = next(
        (word for word in _step_words(recorded.get("task")) if word not in {*step_words(), "repeat"}), ""
    )
    if not unknown:
        return
    try:
        named = parse_json(packages)
    except ValueError:
        named = None
    package = named.get(unknown) if isinstance(named, dict) else None
    install = package[:80] if isinstance(package, str) and package else "the package that provides it"
    raise ConfigError(
        f"the recording was made with the step {unknown[:80]!r}, which is not installed here: install {install}"
    )


def _step_words(table: Any) -> Iterator[str]:
    """Return the words of the steps in the recorded settings of a task, including those of a repeat."""
    for step in _steps(table):
        for each in (step, *_steps(step)):
            if isinstance(word := each.get("do"), str):
                yield word


def _steps(table: Any) -> list[dict[str, Any]]:
    steps = table.get("step") if isinstance(table, dict) else None
    return [step for step in steps if isinstance(step, dict)] if isinstance(steps, list) else []


def changes_of(path: Path | None, controller: str | None) -> dict[str, Any]:
    """Return changes to the recorded run from a TOML file and an option. Raises ConfigError."""
    changes: dict[str, Any] = {}
    if path is not None:
        changes = read_values(path)
        with_program(changes, str(path))
    if controller is not None:
        controller_changes = changes.get("controller", {})
        changes["controller"] = (
            {**controller_changes, "name": controller}
            if isinstance(controller_changes, dict)
            else controller_changes
        )
    return changes


def replay(recording: Recording, config: Config, forced: bool) -> Iterator[ReplayedCycle]:
    """Replay the decision of every recorded cycle.

    With `forced`, each cycle begins from the recorded previous command, otherwise from the replayed one. Raises
    ConfigError for a cycle whose inputs are missing.
    """
    cycles, loop = recording.cycles, Setup(config).loop
    if not cycles:
        return
    state = loop.initial(_vector(cycles[0].start))
    for number, record in enumerate(cycles):
        if record.cycle != number:
            raise ConfigError(f"the inputs of cycle {number} are not in the recording: replay ends there")
        if record.asked:
            state = loop.finish(state, record.asked)
        state, decision = loop.step(state, record.sample)
        replayed = ReplayedCycle(record, decision)
        if forced and replayed.differences:
            commanded = replace(
                state.supervisor, depth=record.depth_commanded, position=_vector(record.target)
            )
            state = replace(state, supervisor=commanded)
        yield replayed


def _merge(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    result = dict(values)
    for key, change in changes.items():
        present = result.get(key)
        both = isinstance(change, Mapping) and isinstance(present, Mapping)
        result[key] = _merge(present, change) if both else change  # type: ignore[arg-type]
    return result


def _vector(values: tuple[float, ...]) -> Vector:
    x, y, z = values
    return x, y, z
