"""A page of the reference: which robots and sensors there are, and what is known of each.

Wire, cycle and marks follow from the kinds. Witnesses are told in docs/explanation/fidelity.md; here stand their names.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from hil_bridge.devices.kinds import (
    ROBOTS,
    SENSORS,
    DeviceKind,
    KindSettings,
    Registry,
    RobotKind,
    SensorKind,
    section_of,
)
from hil_bridge.settings.configuration import Config, with_all_kinds
from hil_bridge.settings.template import profile_rows
from protocol.marks import Mark
from tools.pages import table


class Evidence(NamedTuple):
    """The witnesses that an emulated device was held against."""

    page: str
    """Its page of the reference, without the ending."""
    witnesses: tuple[str, ...]
    """Foreign programs, drivers and documents, by the names of docs/explanation/fidelity.md."""
    recorded: str
    """What others recorded of real devices and the emulator was compared with; empty for nothing."""


_JR3_WITNESSES = ("jr3-mbed-firmware", "SocketCAN")
EVIDENCE: Mapping[str, Evidence] = {
    "s3": Evidence("computer-link", ("the one public client",), "data that the users of that client kept"),
    "egm": Evidence(
        "egm",
        ("ABBRobotEGM", "abb_robot_client", "abb_libegm", "abb_librws"),
        "a virtual controller: ramp of a joint; a real robot: lag of its speeds",
    ),
    "rsi": Evidence(
        "rsi",
        ("RSIPI", "kuka_rsi_hw_interface", "kuka_external_control_sdk", "kuka_rsi_driver"),
        "a robot at 12 ms along a weld seam: lag, cycle",
    ),
    "rtde": Evidence(
        "rtde",
        ("ur_rtde", "C++ client library", "Python client"),
        "UR5e, UR10e, UR3: lag, noise, speeds, forces, contact",
    ),
    "jr3": Evidence("jr3", _JR3_WITNESSES, ""),
    "jr3-uart": Evidence("jr3", ("jr3-mbed-firmware",), ""),
    "jr3-board": Evidence("jr3-registers", ("jr3_pci",), ""),
    "netft": Evidence(
        "netft", ("pynetft", "NetFT"), "Gamma and Axia80: noise, vibration, creep, noise in motion"
    ),
    "ft300": Evidence("ft300", ("ft300python", "robotiq_ft_sensor"), "two records at 10 Hz: noise, step"),
    "ft300-urcap": Evidence("ft300", ("robotiq_ft_sensor_dev",), ""),
    "ati-can": Evidence("ati-can", ("the maker's manual", "ati_netcanoem_ft_driver"), ""),
}
"""By kind."""
_TOLD = (Mark.OBSERVED, Mark.DERIVED, Mark.STANDARD, Mark.ASSUMED, Mark.CHOSEN)


def known_devices() -> str:
    """Return the page."""
    config = with_all_kinds()
    parts = [
        "# Robots and sensors, and what is known of them",
        "Any robot of this page runs with any sensor of it. Each is driven over its real wire, and emulated on the "
        "same wire. **No real controller and no real sensor was at hand when the emulators were made.** Programs, "
        "drivers and documents of others are the witnesses, and files that others recorded of real devices. "
        "[Fidelity](../../explanation/fidelity.md) tells what each of them showed.",
        "## Robots",
        _overview(_kinds(ROBOTS), config),
        "## Sensors",
        _overview(_kinds(SENSORS), config),
        "An S3 is asked; its cycle is as long as its line takes. A sensor without a cycle tells it in its stream.",
        "## What held them",
        table(
            ("kind", "held against", "recorded of real devices"),
            ((_link(name), ", ".join(e.witnesses), e.recorded or "nothing") for name, e in EVIDENCE.items()),
        ),
        "## How well their settings are known",
        "Settings of the emulated device and of its client, by "
        "[mark](../../explanation/decisions/0005-marks-of-facts.md). *Observed* was read from a real device or from a "
        "client that drove one. *Derived* follows from that. *Standard* is usual for such devices. *Assumed* is not "
        "known: correct it on site. *Chosen* is no fact about a device. `hil-bridge list facts` lists the assumed "
        "ones. Kinds in one row share their settings.",
        table(("kind", *map(str, _TOLD)), _mark_rows(config)),
    ]
    return "\n\n".join(parts) + "\n"


def _kinds(registry: Registry[Any]) -> list[DeviceKind]:
    return [registry.kind(name) for name in registry.own]


def _overview(kinds: Sequence[DeviceKind], config: Config) -> str:
    rows = ((_link(kind.name), kind.summary, _scheme(kind, config), _cycle(kind, config)) for kind in kinds)
    return table(("kind", "device and wire", "emulated device listens on", "cycle"), rows)


def _link(name: str) -> str:
    return f"[`{name}`](../{EVIDENCE[name].page}.md)"


def _settings(kind: DeviceKind, config: Config) -> KindSettings[object, object]:
    group = config.robot if isinstance(kind, RobotKind) else config.sensor
    section = section_of(kind)
    return KindSettings(getattr(group, section), getattr(config.cell, section))


def _scheme(kind: DeviceKind, config: Config) -> str:
    assert kind.emulation is not None
    return f"`{kind.emulation.usual(_settings(kind, config), False)}`"


def _cycle(kind: DeviceKind, config: Config) -> str:
    settings = _settings(kind, config)
    if isinstance(kind, SensorKind):
        seconds = kind.period(settings)
        return "told by the sensor" if seconds is None else f"{seconds * 1e3:g} ms"
    seconds = kind.facts("", settings).cycle_s
    return "asked each time" if seconds is None else f"{seconds * 1e3:g} ms"


def _mark_rows(config: Config) -> Iterator[tuple[object, ...]]:
    by_section: dict[str, list[DeviceKind]] = {}
    for kind in (*_kinds(ROBOTS), *_kinds(SENSORS)):
        by_section.setdefault(section_of(kind), []).append(kind)
    for section, kinds in by_section.items():
        marks = count_marks(config, section)
        yield ", ".join(f"`{kind.name}`" for kind in kinds), *(marks[mark] for mark in _TOLD)


def count_marks(config: Config, section: str) -> Counter[Mark]:
    """How many settings of a device's sections have each mark."""
    places = {("robot", section), ("sensor", section), ("cell", section)}
    return Counter(
        setting.info.mark for key, setting in profile_rows(config) if tuple(key.split(".")[:2]) in places
    )
