"""Observations of the guard, made from the facts that a test needs."""

from typing import Any

from msgspec.structs import fields, replace

from hil_bridge.control import Observation, Sample

_OF_SAMPLE = {field.name for field in fields(Sample)}


def observed(before: Observation, **facts: Any) -> Observation:
    """Return the observation with other facts, of its sample or its own. A position is checked unless it is None."""
    if "position" in facts and facts["position"] is None:
        del facts["position"]
        facts["tilt"] = None
    elif "position" in facts and before.sample.tilt is None:
        facts.setdefault("tilt", 0.0)
    of_sample = {name: facts.pop(name) for name in list(facts) if name in _OF_SAMPLE}
    return replace(before, sample=replace(before.sample, **of_sample), **facts)


def observation(
    force: float, now: float = 100.0, resultant: float | None = None, sequence: int = 7, **facts: Any
) -> Observation:
    """Return an observation of a current force along the approach, N."""
    length = abs(force) if resultant is None else resultant
    return observed(Observation(Sample(now, (0.0, 0.0, 0.0), force, length, now, sequence)), **facts)
