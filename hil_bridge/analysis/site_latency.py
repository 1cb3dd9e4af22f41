"""A site's measured latency as settings that its emulation draws from."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from hil_bridge.analysis.latency import answer_times, earliest_arrivals, moments
from hil_bridge.errors import ConfigError
from hil_bridge.recording.reader import Recording
from hil_bridge.text_files import toml_pair
from protocol.s3.adlp import LinkProfile

FEWEST_QUANTILES, MOST_QUANTILES = 21, 201
"""Of each distribution, ends included: one for every value, but no fewer than these, for that is no distribution, and
no more, or nobody could read the file. Chosen: of many values the rare late ones must stay rare, and straight lines
between quantiles 0.5 % apart make no more of them than that.
"""
_DIGITS = 4
"""Of a value in ms: a tenth of a microsecond."""


_GATEWAYS = {"gateway": "cell.gateway", "uart": "cell.uart_gateway"}
"""Sections of the emulated gateways, by what stands before the sensor. A board's samples come when they are read."""


def site_settings(recording: Recording, link: LinkProfile, sensor: str) -> str:
    """A configuration file whose emulated cell is as late as the recorded one.

    `link` is the line as it was. `sensor` is what stood before the sensor, as `sensor.emulated` names it. Raises
    ConfigError for a recording that is too short or was not stamped.
    """
    answers = answer_times(recording)
    if answers is None:
        raise ConfigError("the recording does not tell its link's settings: its latency cannot be reckoned")
    moment = moments(recording.cycles, answers)
    turnarounds = (
        ("status_turnaround_ms", moment("status_replied_at") - moment("status_transmitted_at")),
        ("move_turnaround_ms", moment("replied_at") - moment("transmitted_at")),
    )
    robot = {name: _quantiles_ms(values.tolist(), "cycles") for name, values in turnarounds}
    sections: dict[str, dict[str, object]] = {
        **{section: _line_settings(link) for section in ("robot.link", "cell.link")},
        "cell.robot": {**robot},
    }
    if sensor != "gateway":
        sections["sensor"] = {"emulated": sensor}
    if (gateway := _GATEWAYS.get(sensor)) is not None:
        earliest = earliest_arrivals(recording.sensors)
        jitter = [frame.at - earliest.get(frame.sequence, math.nan) for frame in recording.sensors]
        sections[gateway] = {"delay_ms": _quantiles_ms(jitter, "sensor frames")}
    lines = [
        "# Latency of a recorded run, as evenly spaced quantiles each: turnaround is answer time less",
        "# line time (of a controller that answers a point only when it is reached, the motion too);",
        "# the delay of the sensor's frames is that above the smallest one."
        if gateway
        else "# the delay of a receiver board's samples is not emulated.",
        "# In a file that has a section already, its lines go there.",
    ]
    for section, values in sections.items():
        if values:
            lines += ["", f"[{section}]", *(toml_pair(name, value) for name, value in values.items())]
    return "\n".join(lines) + "\n"


def _line_settings(link: LinkProfile) -> dict[str, object]:
    """What of the line is not as by default."""
    plain = LinkProfile()
    names = (field.name for field in dataclasses.fields(link))
    return {name: getattr(link, name) for name in names if getattr(link, name) != getattr(plain, name)}


def _quantiles_ms(values: Sequence[float], what: str) -> list[float]:
    """Raises ConfigError for fewer values than quantiles."""
    known = [max(value, 0.0) * 1e3 for value in values if math.isfinite(value)]
    if len(known) < FEWEST_QUANTILES:
        raise ConfigError(
            f"the recording holds {len(known)} stamped {what}, a distribution needs {FEWEST_QUANTILES}: "
            "record a longer run"
        )
    found = np.quantile(known, np.linspace(0.0, 1.0, min(len(known), MOST_QUANTILES)))
    return [round(float(value), _DIGITS) for value in found]
