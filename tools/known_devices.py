"""Reference page of the supported robots and sensors, and of the evidence for each.

Wire, cycle and marks are derived from the kinds. docs/explanation/fidelity.md describes the witnesses; this page
names them.
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
    """Evidence for an emulated device: the witnesses that it was compared with."""

    page: str
    """Reference page of the device, without the file extension."""
    witnesses: tuple[str, ...]
    """Third-party programs, drivers and documents, by their names in docs/explanation/fidelity.md."""
    recorded: str
    """Third-party recordings of real devices that the emulator was compared with; empty if there are none."""


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
"""Evidence by kind of device."""
_TOLD = (Mark.OBSERVED, Mark.DERIVED, Mark.STANDARD, Mark.ASSUMED, Mark.CHOSEN)


def known_devices() -> str:
    """Return the page of supported devices."""
    config = with_all_kinds()
    parts = [
        "# Supported robots and sensors",
        "Any robot on this page works with any sensor on it. Each is driven over its real wire, and emulated on the "
        "same wire. **No real controller and no real sensor was available when the emulators were made.** The "
        "emulators were compared with third-party programs, drivers and documents, and with files that others "
        "recorded from real devices. [Fidelity](../../explanation/fidelity.md) describes the results.",
        "## Robots",
        _overview(_kinds(ROBOTS), config),
        "## Sensors",
        _overview(_kinds(SENSORS), config),
        "An S3 is polled; its cycle takes as long as the transfer on its line. A sensor without a cycle in this table "
        "reports it in its stream.",
        "## Evidence",
        table(
            ("kind", "compared with", "recordings of real devices"),
            ((_link(name), ", ".join(e.witnesses), e.recorded or "nothing") for name, e in EVIDENCE.items()),
        ),
        "## Confidence in the settings",
        "Number of settings of the emulated device and of its client, by "
        "[mark](../../explanation/decisions/0005-marks-of-facts.md). *Observed* values come from a real device or from "
        "a client that drove one. *Derived* values follow from those. *Standard* values are usual for such devices. "
        "*Assumed* values are unknown: correct them on site. *Chosen* values are not facts about a device. "
        "`hil-bridge list facts` lists the assumed ones. Kinds in one row share their settings.",
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
        return "reported by the sensor" if seconds is None else f"{seconds * 1e3:g} ms"
    seconds = kind.facts("", settings).cycle_s
    return "polled" if seconds is None else f"{seconds * 1e3:g} ms"


def _mark_rows(config: Config) -> Iterator[tuple[object, ...]]:
    by_section: dict[str, list[DeviceKind]] = {}
    for kind in (*_kinds(ROBOTS), *_kinds(SENSORS)):
        by_section.setdefault(section_of(kind), []).append(kind)
    for section, kinds in by_section.items():
        marks = count_marks(config, section)
        yield ", ".join(f"`{kind.name}`" for kind in kinds), *(marks[mark] for mark in _TOLD)


def count_marks(config: Config, section: str) -> Counter[Mark]:
    """Return the number of settings with each mark in a device's sections."""
    places = {("robot", section), ("sensor", section), ("cell", section)}
    return Counter(
        setting.info.mark for key, setting in profile_rows(config) if tuple(key.split(".")[:2]) in places
    )
