"""Checkers of the promises about the end of a run: the tool is free or is reported as pressing, and the last line
is correct.
"""

import json
import math
from collections.abc import Iterator, Mapping

import numpy as np

from hil_bridge.control.geometry.frames import rotation_matrix
from hil_bridge.lab.invariants.evidence import Evidence, Promise, Trace, Violation
from hil_bridge.lab.invariants.force import world_of
from hil_bridge.lab.invariants.voids import FORCE_AXES, added_n, moves_surface, position_error_m, rows_of
from hil_bridge.record import Outcome

FORCE_OFF_N = 2.0
"""Tolerance of a reported force, N. Chosen: noise, drift and weight error of a common tool."""
FORCE_OFF_SHARE = 0.1
"""Tolerance of a reported force, as a share of the true force. Chosen: noise, drift and weight error of a common
tool.
"""
DEPTH_OFF_M = 1e-3
"""Tolerance of a reported depth, m. Chosen: resolution, and the remaining motion of a servo."""
SOFTEST_N_M = 10e3
"""Stiffness by which a contact may deflect the tip without the robot reporting it, N/m. Chosen: below that of every
built-in arm in the poses of examples/campaigns/guard.toml, which is 12.6 kN/m or more.
"""


def false_ends(evidence: Evidence) -> Iterator[Violation]:
    """Yield a violation if the tool is reported as free at the end, but presses.

    Nothing is reported about a tool that never moved; a surface may have moved to it.
    """
    trace = evidence.trace
    if trace is None:
        return
    rest, end = _rest(evidence), evidence.recording.end
    at, true_n = float(trace.times[-1]), _verified_n(evidence, trace, rest)
    free = bool(rest.get("retracted")) or not rest or end.get("outcome") == Outcome.COMPLETED
    allowed_n = evidence.config.limits.weight_tolerance_n + FORCE_OFF_N
    if not rest:  # it never moved: it was in the surface from the start, or the surface moved to it
        faults = evidence.config.faults
        world = world_of(evidence, evidence.config.frame.approach)
        came_n = math.inf if any(map(moves_surface, faults)) else added_n(faults, world)
        allowed_n = max(allowed_n, float(trace.forces[0]) + FORCE_OFF_N + came_n)
    if free and true_n > allowed_n:
        yield Violation(Promise.END, at, {"true_n": true_n})


def false_last_lines(evidence: Evidence) -> Iterator[Violation]:
    """Yield the force and the depth in the last line if they differ from the true values.

    A value reported as unknown is not an error. No fault excuses a reported force that is too low. A fault of the
    sensor or the robot excuses a reported force that is too high, and a depth that is wrong by at most the position
    error of the robot. The reported depth does not contain the deflection of the arm.
    """
    trace, rest, faults = evidence.trace, _rest(evidence), evidence.config.faults
    if trace is None or not rest:
        return
    at, true_n = float(trace.times[-1]), float(trace.forces[-1])
    reported_n = _number(rest.get("force_n"))
    at_least = bool(rest.get("at_least"))
    if math.isfinite(reported_n):
        low = 0.0 if at_least else _verified_n(evidence, trace, rest) - reported_n
        is_falsified = any(fault.on == "signal" or rows_of(fault) for fault in faults)
        high = 0.0 if is_falsified else reported_n - true_n
        off = max(low, high)
        if off > max(FORCE_OFF_N, FORCE_OFF_SHARE * true_n):
            yield Violation(Promise.LAST_LINE, at, {"told": reported_n, "true": true_n}, "N")
    reported_m, true_m = _number(rest.get("depth_m")), _depth(evidence, trace)
    error_m = position_error_m(faults, world_of(evidence, evidence.config.frame.approach))
    allowed_m = DEPTH_OFF_M + true_n / SOFTEST_N_M + error_m
    if math.isfinite(reported_m) and abs(reported_m - true_m) > allowed_m:
        yield Violation(Promise.LAST_LINE, at, {"told": reported_m * 1e3, "true": true_m * 1e3}, "mm")


def _rest(evidence: Evidence) -> Mapping[str, object]:
    """Return the recorded final state of the tool; empty if the tool never moved."""
    text = evidence.recording.end.get("rest", "")
    rest = json.loads(text) if text else None
    return rest if isinstance(rest, dict) else {}


def _verified_n(evidence: Evidence, trace: Trace, rest: Mapping[str, object]) -> float:
    """Return the magnitude of the true force at the end, N, without the axes that are reported as not verified.

    A moving surface may reach the tool after the newest frame, and a tool that retracts into an obstacle may bounce
    off it. In these cases, the result is the smallest force since the time of the oldest frame that is still valid.
    """
    unverified, truths = rest.get("unverified"), evidence.recording.truths
    forces = trace.forces
    if isinstance(unverified, list) and unverified:
        if trace.vectors is None or not truths or not all(map(math.isfinite, truths[-1].quaternion)):
            return 0.0
        named = {str(name).lower() for name in unverified}
        kept = [axis for axis, name in enumerate(FORCE_AXES) if name not in named]
        forces = np.linalg.norm((trace.vectors @ rotation_matrix(truths[-1].quaternion))[:, kept], axis=1)
    if not any(moves_surface(fault) or fault.on == "obstacle" for fault in evidence.config.faults):
        return float(forces[-1])
    end_s = truths[-1].at if truths else float(trace.times[-1])
    begin_s = end_s - evidence.config.limits.stale_after_ms * 1e-3
    return float(min(forces[trace.times >= begin_s]))


def _depth(evidence: Evidence, trace: Trace) -> float:
    """Return the depth of the tool at the end if every report since the first cycle were true, m, along the approach
    from the start point; NaN if it is unknown.

    The true position differs from the reported one from the start by the sag of the arm under the tool's weight.
    """
    cycles = evidence.recording.cycles
    if trace.positions is None or not cycles:
        return math.nan
    first = min(int(np.searchsorted(trace.times, cycles[0].started_at)), len(trace.times) - 1)
    displacement = trace.positions[-1] - trace.positions[first]
    return cycles[0].depth + float(displacement @ np.array(evidence.config.frame.approach))


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) else math.nan
