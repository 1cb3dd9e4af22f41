"""A site's measured latency as quantiles that an emulation draws from, and as a configuration file of them.

Which settings take them is the devices' own affair: see the modules `latency` of their rooms.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from hil_bridge.devices.facts import Owner
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import toml_pair
from hil_bridge.record.analysis.latency import earliest_arrivals, timestamps
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.reader import Recording

FEWEST_QUANTILES, MOST_QUANTILES = 21, 201
"""Quantiles of each distribution, ends included: one for every value, within these limits. Fewer values are no
distribution; more make a file that nobody can read. Chosen: the rare late values among many must stay rare. Lines
between quantiles 0.5 % apart keep them so.
"""
_DIGITS = 4
"""Decimals of a value in ms: a tenth of a microsecond."""


def robot_quantiles_ms(recording: Recording) -> dict[str, list[float]]:
    """Return the times of the robot's own hops up to its answer, by name, as evenly spaced quantiles.

    Raises ConfigError for a recording that is too short, was not stamped, or does not tell the robot's hops.
    """
    hops = devices_of(recording).robot.hops
    if hops is None:
        raise ConfigError("the recording does not tell its link's settings: its latency cannot be reckoned")
    moment = timestamps(recording.cycles, hops)
    return {
        hop.name: _quantiles_ms((moment(hop.end) - moment(hop.begin)).tolist(), "cycles")
        for hop in (*hops.beside, *hops.to_answer)
        if hop.owner is Owner.ROBOT
    }


def frame_quantiles_ms(recording: Recording) -> list[float]:
    """Delay of the sensor's frames above the smallest one, likewise."""
    earliest = earliest_arrivals(recording.sensors)
    late = [frame.at - earliest.get(frame.sequence, math.nan) for frame in recording.sensors]
    return _quantiles_ms(late, "sensor frames")


def as_configuration(notes: Sequence[str], sections: Mapping[str, Mapping[str, object]]) -> str:
    """Return a configuration file: notes as comments, then the sections that set something."""
    lines = [f"# {note}" for note in notes]
    for section, values in sections.items():
        if values:
            lines += ["", f"[{section}]", *(toml_pair(name, value) for name, value in values.items())]
    return "\n".join(lines) + "\n"


def _quantiles_ms(values: Sequence[float], what: str) -> list[float]:
    """Return evenly spaced quantiles. Raises ConfigError for fewer values than quantiles."""
    known = [max(value, 0.0) * 1e3 for value in values if math.isfinite(value)]
    if len(known) < FEWEST_QUANTILES:
        raise ConfigError(
            f"the recording holds {len(known)} stamped {what}, a distribution needs {FEWEST_QUANTILES}: "
            "record a longer run"
        )
    found = np.quantile(known, np.linspace(0.0, 1.0, min(len(known), MOST_QUANTILES)))
    return [round(float(value), _DIGITS) for value in found]
