"""Preparation of a search from command line options, and use of its result: tuned file, and validation in other
cells.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_bridge.control.controllers import controller_kind
from hil_bridge.control.types import SAMPLE_MS
from hil_bridge.errors import ConfigError
from hil_bridge.lab.tuning.comparing import Comparison
from hil_bridge.lab.tuning.evaluating import Goal, Runs, evaluate, scales_of
from hil_bridge.lab.tuning.reporting import comments
from hil_bridge.lab.tuning.searching import Search, jobs_of
from hil_bridge.lab.tuning.writing import absolute_files, toml, tuned_values
from hil_bridge.record.analysis.figures import TUNED
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config, dump, load_config

_MINIMISED = ("rms_error_n", "overshoot_percent")
_AXES = ("rise_s", "overshoot_percent")


def axes_of(text: str | None) -> tuple[str, str]:
    """Parse the two figures of a trade-off from a text `X:Y`. Raises ConfigError."""
    first, colon, second = (text or ":".join(_AXES)).partition(":")
    if not colon or first not in TUNED or second not in TUNED:
        raise ConfigError(f"--trade {text}: must be X:Y with two of {', '.join(TUNED)}")
    return first, second


def limit_of(config: Config, force_limit_n: float | None) -> float:
    """Return the limit of the true force, N. The default is the limit of the guard. Raises ConfigError."""
    limit = config.limits.force_limit_n if force_limit_n is None else force_limit_n
    if not 0.0 < limit < float("inf"):
        raise ConfigError(f"--force-limit: must be greater than 0, got {limit:g}")
    return limit


def weights_of(minimise: Sequence[str]) -> dict[str, float]:
    """Parse the figures to minimise from texts `FIGURE=WEIGHT`. Raises ConfigError."""
    return dict(_weight(text) for text in minimise or _MINIMISED)


def _weight(text: str) -> tuple[str, float]:
    name, equals, number = text.partition("=")
    if name not in TUNED:
        raise ConfigError(f"--minimise {text}: not a figure for tuning; known: {', '.join(TUNED)}")
    try:
        weight = float(number) if equals else 1.0
    except ValueError:
        weight = 0.0
    if not 0.0 < weight < float("inf"):
        raise ConfigError(f"--minimise {text}: the weight must be a number greater than 0")
    return name, weight


def load_other_cell(place: Path, tuned: Config) -> Config:
    """Load another cell for the tuned controller: all settings of the file except `[controller]`, at the tuned
    pace.

    The defaults of the controller are those in the tuned cell. Raises ConfigError.
    """
    kind = controller_kind(tuned.controller.name)
    sample_ms = tuned.controller.sample_ms or float(getattr(kind, "sample_ms", SAMPLE_MS))
    values = {
        "controller.name": tuned.controller.name,
        "controller.parameters": dict(tuned.controller.parameters),
        "controller.sample_ms": sample_ms,
        "run.duration_s": tuned.run.duration_s,
    }
    config = Setup(load_config(place, values)).config
    if config.robot.url or config.sensor.url:
        raise ConfigError(
            f"{place}: tuning runs on emulated cells only; leave robot.url and sensor.url empty"
        )
    return config


def compare_with_defaults(name: str, config: Config, state: Search, runs: Runs) -> Comparison:
    """Compare the best point with the defaults in another cell, both on fresh seeds. The scores are scaled by the
    defaults in that cell.
    """
    best, plan, text = state.best, state.plan, dump(config)
    assert best is not None, "a feasible point to compare"
    fresh, count = plan.fresh, len(plan.fresh)
    jobs = [*jobs_of(text, plan.space.table(best.point), fresh), *jobs_of(text, {}, fresh)]
    figures = runs(jobs)
    goal = Goal(plan.weights, plan.force_limit_n, scales_of(plan.weights, figures[count:]))
    tuned = evaluate(goal, best.point, figures[:count])
    return Comparison(name, tuned, evaluate(goal, state.defaults.point, figures[count:]))


def tuned_file(values: Mapping[str, Any], config: Config, state: Search, source: Path | None) -> str:
    """Return the tuned configuration as TOML."""
    best = state.best
    assert best is not None, "a feasible point to write"
    result = tuned_values(values, config, state.plan.space.table(best.point))
    absolute_files(result)
    return toml(result, list(comments(state, "the defaults" if source is None else source.name)))
