"""Measured latency of a site: quantiles for an emulation to draw from, and a configuration file that contains them.

The module `latency` of each device defines which of the device's settings accept quantiles.
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
"""Minimum and maximum number of quantiles of a distribution, including both ends. Within these limits, there is one
quantile per value.

Chosen: fewer values do not define a distribution, and more quantiles make the file hard to read. With lines between
quantiles 0.5 % apart, the few late values among many stay rare.
"""
_DIGITS = 4
"""Decimal places of a value in ms, which correspond to 0.1 µs."""


def robot_quantiles_ms(recording: Recording) -> dict[str, list[float]]:
    """Return the durations of the robot's own hops up to its response, by name, as evenly spaced quantiles, ms.

    Raises ConfigError for a recording that is too short, has no time stamps, or does not contain the robot's hops.
    """
    hops = devices_of(recording).robot.hops
    if hops is None:
        raise ConfigError("the recording lacks the settings of its link: cannot compute its latency")
    moment = timestamps(recording.cycles, hops)
    return {
        hop.name: _quantiles_ms((moment(hop.end) - moment(hop.begin)).tolist(), "cycles")
        for hop in (*hops.beside, *hops.to_answer)
        if hop.owner is Owner.ROBOT
    }


def frame_quantiles_ms(recording: Recording) -> list[float]:
    """Return the delay of each sensor frame in excess of the smallest delay, as evenly spaced quantiles, ms."""
    earliest = earliest_arrivals(recording.sensors)
    late = [frame.at - earliest.get(frame.sequence, math.nan) for frame in recording.sensors]
    return _quantiles_ms(late, "sensor frames")


def as_configuration(notes: Sequence[str], sections: Mapping[str, Mapping[str, object]]) -> str:
    """Return the text of a configuration file: the notes as comments, followed by the sections that are not empty."""
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
            f"the recording holds {len(known)} time-stamped {what}; a distribution needs at least {FEWEST_QUANTILES}: "
            "record a longer run"
        )
    quantiles = np.quantile(known, np.linspace(0.0, 1.0, min(len(known), MOST_QUANTILES)))
    return [round(float(value), _DIGITS) for value in quantiles]
