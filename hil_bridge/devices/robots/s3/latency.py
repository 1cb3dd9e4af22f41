"""A site's measured latency as settings of the emulated S3."""

import dataclasses
from collections.abc import Mapping, Sequence

from protocol.devices.s3.adlp import LinkProfile

NOTES = (
    "Latency of a recorded run, as evenly spaced quantiles each: turnaround is answer time less",
    "line time (of a controller that answers a point only when it is reached, the motion too);",
)
"""Notes for an operator about these settings."""


def late_settings(
    quantiles_ms: Mapping[str, Sequence[float]], line: LinkProfile
) -> dict[str, dict[str, object]]:
    """Settings by section of a controller that takes so long for its own hops, see `hops`, on the line as it was."""
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
