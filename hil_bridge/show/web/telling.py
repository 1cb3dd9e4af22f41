"""A snapshot of a run as plain values for its page, and the description of its charts."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from msgspec.structs import replace

from hil_bridge.devices.facts import LATE, Pacing
from hil_bridge.errors.text_files import harmless
from hil_bridge.record.ending import ALARMS, CAUTIONS, PHASE_EVENT, Check
from hil_bridge.record.records import EventRecord
from hil_bridge.show.pages.description import Axis, Band, Chart, Charts, Layer, Series, Span
from hil_bridge.show.run_marks import (
    DEPTH,
    FORCE,
    LATERAL,
    MOMENTS,
    STIFFNESS,
    TIMES,
    limits_of,
    line_of,
)
from hil_bridge.show.terminal import Scene, Snapshot
from hil_bridge.show.web.columns import MILLI, tidy

TEXT_LENGTH = 400
"""Characters of a text that the page shows at most."""


def told_scene(scene: Scene) -> dict[str, Any]:
    """Facts of a run that stay the same."""
    limits = scene.limits
    return {
        "cell": harmless(scene.cell),
        "real": scene.real,
        "steps": list(scene.steps),
        "total_s": scene.total_s,
        "record": scene.record,
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


def told_now(snapshot: Snapshot) -> dict[str, Any]:
    """Values of a moment. Lengths are mm, times ms or s as their names tell, forces N, moments N·m."""
    newest = snapshot.newest
    latency = snapshot.latency
    told: dict[str, Any] = {
        "phase": snapshot.phase,
        "elapsed_s": tidy(snapshot.elapsed_s),
        "tracked_s": tidy(snapshot.tracked_s),
        "remaining_s": snapshot.remaining_s,
        "target": tidy(snapshot.reference_n),
        "wants_force": snapshot.wants_force,
        "held": snapshot.held,
        "step": snapshot.step,
        "step_label": harmless(snapshot.step_label),
        "cause": harmless(snapshot.cause)[:TEXT_LENGTH],
        "check": harmless(snapshot.check)[:TEXT_LENGTH],
        "warning": harmless(snapshot.warning)[:TEXT_LENGTH],
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
        told |= {
            "cycle": newest.cycle,
            "force": tidy(newest.force),
            "in_contact": newest.in_contact,
            "lateral": None if snapshot.lateral_n is None else tidy(snapshot.lateral_n),
            "resultant": tidy(snapshot.resultant_n),
            "moment": tidy(snapshot.moment_nm),
            "wrench": [tidy(value) for value in newest.wrench],
            "depth_mm": tidy(newest.depth * MILLI),
            "commanded_mm": tidy(newest.depth_commanded * MILLI),
            "correction_mm": tidy(newest.correction * MILLI),
            "travel_mm": tidy(newest.travel_commanded * MILLI),
            "stiffness": None if newest.stiffness is None else tidy(newest.stiffness),
            "gain": newest.gain,
            "resting": newest.held,
            "verdict": newest.verdict,
            "reasons": list(newest.reasons),
            "answer_ms": _ms(newest.answer_s),
            "quaternion": [tidy(value) for value in newest.quaternion],
        }
    return told


def told_event(event: EventRecord, began: float) -> dict[str, Any]:
    """An event as a row of the page."""
    weight = "alarm" if event.kind in ALARMS else "caution" if event.kind in CAUTIONS else ""
    return {
        "at": tidy(event.at - began),
        "kind": event.kind,
        "text": line_of(event)[:TEXT_LENGTH],
        "weight": weight,
    }


def is_zero(event: EventRecord) -> bool:
    """Whether it tells the zero that was taken."""
    return event.check is Check.ZERO


def spans_of(phases: Sequence[tuple[float, str]], until: float) -> list[Span]:
    """The phases as stretches, from when each began; the last one lasts until now."""
    ends = [begin for begin, _ in phases[1:]] + [until]
    return [Span(begin, max(begin, end), name, name) for (begin, name), end in zip(phases, ends, strict=True)]


def phases_in(events: Iterable[EventRecord], began: float) -> list[tuple[float, str]]:
    """Begin and name of each phase that these events tell."""
    return [(event.at - began, event.text) for event in events if event.kind == PHASE_EVENT]


def charts_of(scene: Scene, wall_start_s: float | None) -> Charts:
    """What `charts.js` draws of a run.

    It makes room for the force limit, which a report does not: a person sees how near the force is.
    """
    limits, truth = asdict(scene.limits), "truth" if scene.robot.emulated else ""

    def true(column: str) -> tuple[Series, ...]:
        return (Series("truth", column, "true", "truth", layer="truth"),) if truth else ()

    times = [
        Series("cycle", "cycle", "cycle to cycle", "1"),
        Series("cycle", "age", "age of the sensor frame", "3"),
    ]
    if scene.robot.pacing is Pacing.STREAMED:
        times.insert(1, Series("cycle", "answer", "answer", "2"))
    force = Chart(
        "force",
        "Force",
        "N",
        (
            Series("cycle", "force", "force", "1", width=1.8),
            Series("cycle", "target", "target", "target", "step", dashed=True),
            *true("force"),
        ),
        (Band("cycle", "low", "high", "least and greatest", layer="range"),),
        [replace(limit, shown=limit.value > 0.0) for limit in limits_of("force", limits)],
        height_px=250,
        **FORCE._asdict(),
    )
    charts = (
        force,
        Chart(
            "lateral",
            "Lateral force",
            "N",
            (Series("cycle", "lateral", "across the approach", "2"),),
            limits=limits_of("lateral", limits),
            height_px=110,
            **LATERAL._asdict(),
        ),
        Chart(
            "moments",
            "Moments",
            "N·m",
            tuple(
                Series("cycle", name, name, colour)
                for name, colour in (("mx", "1"), ("my", "2"), ("mz", "3"))
            ),
            limits=limits_of("moments", limits),
            height_px=110,
            **MOMENTS._asdict(),
        ),
        Chart(
            "depth",
            "Depth from the start point",
            "mm",
            (
                Series("cycle", "depth", "reported", "1"),
                Series("cycle", "commanded", "commanded", "2", "step"),
                *true("depth"),
            ),
            limits=limits_of("depth", limits),
            height_px=150,
            **DEPTH._asdict(),
        ),
        Chart(
            "stiffness",
            "Estimated stiffness",
            "N/m",
            (Series("cycle", "stiffness", "stiffness", "6"),),
            height_px=100,
            **STIFFNESS._asdict(),
        ),
        Chart(
            "times",
            "Times",
            "ms",
            tuple(times),
            limits=limits_of("times", limits, scene.robot.line_floor_s),
            height_px=120,
            **TIMES._asdict(),
        ),
    )
    layers = (Layer("range", "least and greatest"), *((Layer("truth", "truth"),) if truth else ()))
    empty: Mapping[str, Any] = {"cycle": {"x": []}, "truth": {"x": []}}
    return Charts({"time": Axis("time since the run began", "s", wall_start_s)}, charts, empty, layers=layers)


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else tidy(seconds * MILLI)
