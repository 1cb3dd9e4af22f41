"""Settings of the emulated S3 for the measured latency of a site."""

import dataclasses
from collections.abc import Mapping, Sequence

from protocol.devices.s3.adlp import LinkProfile

NOTES = (
    "Latency of a recorded run, as evenly spaced quantiles each: turnaround is answer time less",
    "line time (including the motion, if the controller answers a point only when it is reached);",
)
"""Comment lines that explain these settings."""


def late_settings(
    quantiles_ms: Mapping[str, Sequence[float]], line: LinkProfile
) -> dict[str, dict[str, object]]:
    """Return the settings by section for a controller whose internal hops (see `hops`) have these durations on the
    recorded line.
    """
    plain = LinkProfile()
    names = [field.name for field in dataclasses.fields(line)]
    changed = {name: getattr(line, name) for name in names if getattr(line, name) != getattr(plain, name)}
    return {
        "robot.s3.link": changed,
        "cell.s3.link": changed,
        "cell.s3.robot": {
            "status_turnaround_ms": [*quantiles_ms["status_turnaround"]],
            "move_turnaround_ms": [*quantiles_ms["turnaround"]],
        },
    }
