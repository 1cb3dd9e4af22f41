"""From a person's words to a search, and from its end to a file and to other cells."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_bridge.control.controllers import controller_kind
from hil_bridge.control.types import SAMPLE_MS
from hil_bridge.errors import ConfigError
from hil_bridge.lab.tuning.comparing import Comparison
from hil_bridge.lab.tuning.evaluating import Goal, Runs, scales_of, worth
from hil_bridge.lab.tuning.reporting import comments
from hil_bridge.lab.tuning.searching import Search, jobs_of
from hil_bridge.lab.tuning.writing import absolute_files, toml, tuned_values
from hil_bridge.record.analysis.figures import TUNED
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config, dump, load_config

_MINIMISED = ("rms_error_n", "overshoot_percent")
_AXES = ("rise_s", "overshoot_percent")


def axes_of(text: str | None) -> tuple[str, str]:
    """Two figures of a trade-off, `X:Y`. Raises ConfigError."""
    first, colon, second = (text or ":".join(_AXES)).partition(":")
    if not colon or first not in TUNED or second not in TUNED:
        raise ConfigError(f"--trade {text}: write X:Y with two of {', '.join(TUNED)}")
    return first, second


def limit_of(config: Config, force_limit_n: float | None) -> float:
    """The true force that a point may reach, N: the guard's limit where none is given. Raises ConfigError."""
    limit = config.limits.force_limit_n if force_limit_n is None else force_limit_n
    if not 0.0 < limit < float("inf"):
        raise ConfigError(f"--force-limit: must be a number above 0, got {limit:g}")
    return limit


def weights_of(minimise: Sequence[str]) -> dict[str, float]:
    """The figures to be made small, `FIGURE=WEIGHT`, with their weights. Raises ConfigError."""
    return dict(_weight(text) for text in minimise or _MINIMISED)


def _weight(text: str) -> tuple[str, float]:
    name, equals, number = text.partition("=")
    if name not in TUNED:
        raise ConfigError(f"--minimise {text}: no figure to be tuned for; choose from {', '.join(TUNED)}")
    try:
        weight = float(number) if equals else 1.0
    except ValueError:
        weight = 0.0
    if not 0.0 < weight < float("inf"):
        raise ConfigError(f"--minimise {text}: the weight must be a number above 0")
    return name, weight


def others(place: Path, tuned: Config) -> Config:
    """Another cell for the same controller: all of the file but `[controller]`, with the pace of the tuned one.

    Its defaults are those of the cell that was tuned. Raises ConfigError.
    """
    kind = controller_kind(tuned.controller.name)
    sample_ms = tuned.controller.sample_ms or float(getattr(kind, "sample_ms", SAMPLE_MS))
    given = {
        "controller.name": tuned.controller.name,
        "controller.parameters": dict(tuned.controller.parameters),
        "controller.sample_ms": sample_ms,
        "run.duration_s": tuned.run.duration_s,
    }
    config = Setup(load_config(place, given)).config
    if config.robot.url or config.sensor.url:
        raise ConfigError(f"{place}: cells are emulated; leave robot.url and sensor.url empty")
    return config


def compare_with_defaults(name: str, config: Config, state: Search, runs: Runs) -> Comparison:
    """The best against the defaults in another cell, both on fresh seeds, weighed by the defaults there."""
    best, fresh, text = state.best, state.wanted.fresh, dump(config)
    assert best is not None, "there is one to be compared"
    jobs = [*jobs_of(text, state.wanted.space.table(best.point), fresh), *jobs_of(text, {}, fresh)]
    found = runs(jobs)
    count = len(fresh)
    wanted = state.wanted
    goal = Goal(wanted.weights, wanted.force_limit_n, scales_of(wanted.weights, found[count:]))
    tuned = worth(goal, best.point, found[:count])
    return Comparison(name, tuned, worth(goal, state.defaults.point, found[count:]))


def tuned_file(values: Mapping[str, Any], config: Config, state: Search, source: Path | None) -> str:
    """The tuned configuration as TOML."""
    best = state.best
    assert best is not None, "there is one to be written"
    found = tuned_values(values, config, state.wanted.space.table(best.point))
    absolute_files(found)
    return toml(found, list(comments(state, "the defaults" if source is None else source.name)))
