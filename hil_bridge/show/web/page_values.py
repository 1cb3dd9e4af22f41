"""Snapshot of a run as plain values for its page."""

from typing import Any

from hil_bridge.devices.facts import LATE, Pacing
from hil_bridge.errors.text_files import harmless
from hil_bridge.record.ending import Check
from hil_bridge.record.records import EventRecord
from hil_bridge.show.charts.columns import MILLI, round_digits
from hil_bridge.show.charts.events import line_of, weight_of
from hil_bridge.show.terminal import Scene, Snapshot

TEXT_LENGTH = 400
"""Maximum number of characters in a text on the page."""


def scene_values(scene: Scene) -> dict[str, Any]:
    """Return the constant facts of a run."""
    limits = scene.limits
    return {
        "cell": harmless(scene.cell),
        "devices": harmless(scene.devices),
        "real": scene.real,
        "steps": list(scene.steps),
        "total_s": scene.total_s,
        "record": scene.places.record,
        "floor_ms": _ms(scene.robot.line_floor_s),
        "streamed": scene.robot.pacing is Pacing.STREAMED,
        "limits": {
            "force": limits.force_limit_n,
            "pull": limits.pull_limit_n,
            "resultant": limits.resultant_limit_n,
            "moment": limits.moment_limit_nm,
            "stale_ms": limits.stale_after_ms,
            "depth_mm": limits.correction_total_mm,
        },
    }


def now_values(snapshot: Snapshot) -> dict[str, Any]:
    """Return the values of a snapshot: lengths in mm, times in ms or s as named, forces in N, moments in N·m."""
    newest = snapshot.newest
    latency = snapshot.latency
    values: dict[str, Any] = {
        "phase": snapshot.phase,
        "elapsed_s": round_digits(snapshot.elapsed_s),
        "tracked_s": round_digits(snapshot.tracked_s),
        "remaining_s": snapshot.remaining_s,
        "target": round_digits(snapshot.reference_n),
        "wants_force": snapshot.is_force_controlled,
        "held": snapshot.held,
        "step": snapshot.step,
        "step_label": harmless(snapshot.step_label),
        "cause": _text(snapshot.cause),
        "check": _text(snapshot.check),
        "warning": _text(snapshot.warning),
        "cycle_ms": _ms(snapshot.cycle_time_s),
        "age_ms": _ms(snapshot.sensor_age_s),
        "link_errors": snapshot.link_errors,
        "frames_lost": snapshot.frames_lost,
        "late": snapshot.link.get(LATE, 0),
        "troubles": snapshot.link_troubles,
        "traffic": [
            [one.what, snapshot.link.get(one.sent, 0), snapshot.link.get(one.received, 0)]
            for one in snapshot.scene.robot.traffic
        ],
        "latency": None
        if latency is None
        else {
            "name": latency.name,
            "p50_ms": _ms(latency.total.p50_s),
            "p99_ms": _ms(latency.total.p99_s),
            "max_ms": _ms(latency.total.max_s),
        },
    }
    if newest is not None:
        values |= {
            "cycle": newest.cycle,
            "force": round_digits(newest.force),
            "in_contact": newest.in_contact,
            "lateral": None if snapshot.lateral_n is None else round_digits(snapshot.lateral_n),
            "resultant": round_digits(snapshot.resultant_n),
            "moment": round_digits(snapshot.moment_nm),
            "wrench": [round_digits(value) for value in newest.sample.wrench],
            "depth_mm": round_digits(newest.depth * MILLI),
            "commanded_mm": round_digits(newest.depth_commanded * MILLI),
            "correction_mm": round_digits(newest.correction * MILLI),
            "travel_mm": round_digits(newest.travel_commanded * MILLI),
            "stiffness": None if newest.stiffness is None else round_digits(newest.stiffness),
            "gain": newest.gain,
            "resting": newest.held,
            "verdict": newest.verdict,
            "reasons": list(newest.reasons),
            "answer_ms": _ms(newest.answer_s),
        }
    return values


def event_values(event: EventRecord, began: float) -> dict[str, Any]:
    """Return an event as a row of the page."""
    return {
        "at": round_digits(event.at - began),
        "kind": event.kind,
        "text": line_of(event)[:TEXT_LENGTH],
        "weight": weight_of(event),
        "cause": "" if event.cause is None else str(event.cause),
    }


def is_zero(event: EventRecord) -> bool:
    """Return whether the event reports the sensor zero."""
    return event.check is Check.ZERO


def _text(text: str) -> str:
    return harmless(text)[:TEXT_LENGTH]


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round_digits(seconds * MILLI)
