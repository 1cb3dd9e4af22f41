"""Identity of a run: date, host, devices and versions."""

from datetime import UTC, datetime
from typing import Any

from hil_bridge.record.analysis.summary import Summary
from hil_bridge.record.device_facts import device_urls, devices_of, recorded_configuration
from hil_bridge.record.reader import Recording
from hil_bridge.show.charts.facts import start_time

EMULATED, REAL, MIXED = "EMULATED", "REAL", "PARTLY REAL"
_UNKNOWN = "not in the recording"
_YEAR_3000_S = 32503680000.0


def reality(recording: Recording) -> str:
    """Return whether robot and sensor were emulated, as `EMULATED`, `REAL` or `PARTLY REAL`; empty if unknown."""
    urls = device_urls(recording)
    if urls is None:
        return ""
    return {0: EMULATED, 1: MIXED, 2: REAL}[sum(bool(url) for url in urls)]


def run_title(recording: Recording) -> str:
    """Return the title of a run's page: robot, sensor, and the surface of an emulated cell."""
    devices = devices_of(recording)
    robot = devices.robot.model or devices.robot.kind
    surface = _surface(recording)
    parts = [robot, devices.sensor.kind, f"{surface} surface" if surface else ""]
    return " · ".join(filter(None, parts)) or "Force control run"


def identity_rows(recording: Recording, summary: Summary) -> list[tuple[str, str]]:
    """Return names and values for the top of a page."""
    devices, metadata = devices_of(recording), recording.metadata
    urls = device_urls(recording) or ("", "")
    robot = devices.robot.model or devices.robot.kind
    facts = devices.sensor.facts
    sensor = " ".join(filter(None, (devices.sensor.kind, facts.model if facts else "")))
    named = {
        "date": _date(recording),
        "host": metadata.get("host", ""),
        "version": _versions(recording),
        "robot": _device(robot, urls[0], device_urls(recording) is not None),
        "sensor": _device(sensor, urls[1], device_urls(recording) is not None),
        "surface": f"{surface}, emulated" if (surface := _surface(recording)) else "",
        "controller": summary.controller,
        "seed": summary.seed if reality(recording) != REAL else "",
    }
    return [(name, value) for name, value in named.items() if value]


def _device(name: str, url: str, known: bool) -> str:
    where = f"at {url}" if url else "emulated" if known else ""
    return ", ".join(filter(None, (name, where)))


def _surface(recording: Recording) -> str:
    """Return the kind of the emulated surface; empty for a real one."""
    cell: Any = recorded_configuration(recording).get("cell")
    if not isinstance(cell, dict) or reality(recording) not in (EMULATED, MIXED):
        return ""
    surface = cell.get("surface")
    kind = cell.get("surface_kind") or (surface.get("kind") if isinstance(surface, dict) else "")
    return kind if isinstance(kind, str) else ""


def _date(recording: Recording) -> str:
    if recording.metadata.get("time") == "virtual":
        return f"{_day(recording.written_at)}; in virtual time" if recording.written_at else "in virtual time"
    at = recording.unix_zero_ns * 1e-9 + start_time(recording)
    if not recording.unix_zero_ns or not 0.0 < at < _YEAR_3000_S:
        return _UNKNOWN
    return _day(at)


def _day(at: float) -> str:
    return datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _versions(recording: Recording) -> str:
    own = recording.metadata.get("version", "")
    platform = recording.metadata.get("platform", "")
    return ", ".join(filter(None, (f"hil-bridge {own}" if own else "", platform)))
