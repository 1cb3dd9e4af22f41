"""Reference of names for authors of devices, controllers, steps, surfaces and tests; autodoc adds types, links and
sources.

`GROUPS` lists the names that the documentation recommends to authors. A test compares the list with the pages.
"""

import dataclasses
import inspect
import types
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from typing import Any

import hil_bridge
from hil_bridge import api

Names = Mapping[str, tuple[str, ...]]
"""Names, by the module from which an author imports them."""

GROUPS: Mapping[str, Names] = {
    "The kind of a device": {
        "hil_bridge.devices.kinds": (
            "RobotKind",
            "RobotEmulation",
            "SensorKind",
            "SensorEmulation",
            "SurfaceKind",
            "KindSettings",
            "CanBus",
        ),
        "hil_bridge.devices.wiring": ("Wiring", "Serving"),
        "hil_bridge.devices.trajectory": ("Trajectory", "TrajectoryResult", "stream_trajectory"),
        "hil_bridge.transports.urls": ("WireUrl", "parse_url", "with_baudrate", "with_option"),
        "hil_bridge.transports.bundle": ("Bundle",),
        "hil_bridge.transports.tcp": ("peer_of",),
        "protocol.marks": (
            "setting",
            "Mark",
            "Bounds",
            "at_least",
            "between",
            "above",
            "check_settings",
            "SettingError",
        ),
    },
    "On the wire": {
        "protocol.endpoint": ("Endpoint", "LocalProtocolError", "RemoteProtocolError"),
        "protocol.outbox": ("Due", "Outbox", "Mailbox"),
        "protocol.datagram": ("arrived_at",),
        "protocol.can.frame": ("CanFrame", "CanFilter"),
        "protocol.geometry": ("Pose",),
        "protocol.pieces": ("Piece",),
    },
    "Client of a force sensor": {
        "protocol.wrench": (
            "SensorClient",
            "SensorFacts",
            "SensorReady",
            "WrenchFrame",
            "Zeroed",
            "SensorRestarted",
            "SensorStopped",
            "SensorNotice",
            "SensorFailed",
            "SensorStatistics",
            "HostTare",
        ),
        "protocol.sensor_events": ("SensorEventQueue",),
    },
    "Client of a robot": {
        "protocol.robot": (
            "StreamClient",
            "ReportReceived",
            "RobotReport",
            "StreamLost",
            "StreamNotice",
            "pose_fault",
        ),
        "hil_bridge.devices.robots.streamed": ("StreamedLink",),
        "hil_bridge.devices.robots.request_channel": ("RequestChannel",),
        "hil_bridge.devices.robots.seam": ("RobotLink", "Motion", "MotionLimits"),
        "hil_bridge.devices.facts": (
            "RobotFacts",
            "Pacing",
            "ServoFacts",
            "RobotHops",
            "Hop",
            "Moment",
            "Owner",
            "Traffic",
            "WitnessFacts",
        ),
    },
    "Emulated devices": {
        "emulators.seams": (
            "EmulatedRobot",
            "FeelingRobot",
            "EmulatedSensor",
            "WrenchSource",
            "MovingSource",
            "Surface",
            "ShapedSurface",
            "ArmPath",
            "StartPose",
        ),
        "emulators.arm.followed": ("FollowedArm", "FollowedProfile"),
        "emulators.arm.reported_pose": ("ReportedPose",),
        "emulators.sensing": ("NoisyWrench", "MeasuredWrench", "Converter"),
        "emulators.panel": ("Controls", "Switch", "Dial"),
        "emulators.orders": ("ReportingRobot", "Orders", "ReceivedOrder", "Act", "Reach", "Hindrance"),
    },
    "Faults of emulated devices": {
        "emulators.faults": ("Fault", "Parameter", "FOREVER", "Injection"),
        "emulators.faults.own": ("OwnFaults",),
        "emulators.faults.packets": (
            "Packets",
            "Pieces",
            "BYTES",
            "FRAMES",
            "DATAGRAMS",
            "SENSOR_WIRE",
            "WIRE",
        ),
        "emulators.sensing.faults": ("SIGNAL_FAULTS",),
    },
    "Controllers": {"hil_bridge.control.types": ("Controller", "Measurement", "Command", "Tuning", "Range")},
    "Steps of a program": {
        "hil_bridge.control.steps.led": ("LedStep", "StepSample", "Lead"),
        "hil_bridge.control.steps.pressing": ("PressingStep", "Guide", "PathPoint"),
        "hil_bridge.control.steps.seam": (
            "Step",
            "StepLimits",
            "NO_LIMITS",
            "Criterion",
            "Drawing",
            "StepContext",
            "StepResult",
            "above_zero",
        ),
        "hil_bridge.control.course.intent": ("Phase",),
        "hil_bridge.control.course.stroke": ("Order", "Stroke", "StrokeState"),
        "hil_bridge.control.course.contact_sample": ("ContactSample",),
        "hil_bridge.control.course.state": ("Course", "StepState"),
        "hil_bridge.control.steps.plan": ("StepPlan",),
    },
    "Tests": {
        "hil_bridge.testing": ("RobotCase", "SensorCase", "SurfaceCase", "SUITE_VERSION"),
        "hil_bridge.testing.ends": ("StreamCase", "DatagramCase"),
        "hil_bridge.testing.plugin": ("hil_simulate", "hil_cell", "hil_live", "hil_conform"),
        "hil_bridge.transports": ("memory_pair", "Transport"),
    },
    "Errors": {
        "hil_bridge.errors": (
            "BridgeError",
            "ConfigError",
            "DeviceError",
            "OrderRefused",
            "SafetyStop",
            "TransportError",
            "TransportBroken",
            "TransportClosed",
            "TransportEnded",
            "TransportUnavailable",
            "Cause",
            "Part",
            "Reason",
        )
    },
}
"""Groups of names by purpose, in the order of the page."""


def author_names() -> str:
    """Return the page of names that an author of a device, a controller, a step, a surface or a test imports."""
    parts = [
        "# Names for authors",
        "Every name that a page tells you to use for a device, a controller, a step, a surface or a test of your own. "
        "*source* at the right shows the code. [Devices](../../how-to/devices.md), "
        "[controllers](../../how-to/controllers.md), [steps](../../how-to/steps.md), "
        "[surfaces](../../how-to/surfaces.md) and [tests](../testing.md) tell how they are used. "
        "[Names of the package](names.md) has those for scripts.",
    ]
    for title, modules in GROUPS.items():
        parts.append(f"## {title}")
        for module, names in modules.items():
            parts += [f"### `{module}`", _directives(module, names)]
    return "\n\n".join(parts) + "\n"


def package_names() -> str:
    """Return the page of the public names of the package."""
    parts = [
        "# Names of the package",
        "Every public name of `hil_bridge`. [The Python interface](../api.md) shows how they are used.",
    ]
    for name in sorted(api.__all__):
        parts += [f"## {name}", _directives("hil_bridge", (name,))]
    return "\n\n".join(parts) + "\n"


def _directives(module: str, names: Iterable[str]) -> str:
    lines = [line for name in names for line in _directive(module, name)]
    return "\n".join(["```{eval-rst}", *lines, "```"])


def _directive(module: str, name: str) -> Iterator[str]:
    thing = getattr(import_module(module), name)
    yield f".. auto{_sort(thing)}:: {module}.{name}"
    if module == "hil_bridge" and _is_documented_elsewhere(name):
        yield "   :no-index:"
    if _has_members(thing):
        yield "   :members:"
        yield f"   :exclude-members: __new__{'' if _has_own_init(thing) else ', __init__'}"
    yield ""


def _sort(thing: Any) -> str:
    if inspect.isclass(thing):
        return "exception" if issubclass(thing, BaseException) else "class"
    return "data" if isinstance(thing, types.UnionType) or not callable(thing) else "function"


def _has_members(thing: Any) -> bool:
    return inspect.isclass(thing) and thing.__module__.split(".")[0] in (
        "hil_bridge",
        "emulators",
        "protocol",
    )


def _has_own_init(thing: Any) -> bool:
    """Return whether a class has a hand-written `__init__`, unlike dataclasses and protocols."""
    return (
        _has_members(thing)
        and not dataclasses.is_dataclass(thing)
        and inspect.isfunction(vars(thing).get("__init__"))
        and not getattr(thing, "_is_protocol", False)
    )


def _is_documented_elsewhere(name: str) -> bool:
    """Return whether the authors' page documents the same object under its own module."""
    thing = getattr(hil_bridge, name)
    return any(
        getattr(import_module(module), name, None) is thing and name in names
        for modules in GROUPS.values()
        for module, names in modules.items()
    )
