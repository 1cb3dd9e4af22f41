"""Device package for the S3: kind of robot, client and emulator."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from emulators.devices.s3 import S3_CONTROLS, S3_FAULTS, S3Profiles, S3Site, make_robot
from emulators.seams import RobotFactory
from hil_bridge.devices.emulator_fit import LateSettings
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.kinds import KindSettings, RobotEmulation, RobotKind
from hil_bridge.devices.robots.probe import ProbeResult, first_answer
from hil_bridge.devices.robots.s3.emulator_fit import match
from hil_bridge.devices.robots.s3.facts import robot_facts
from hil_bridge.devices.robots.s3.latency import NOTES, late_settings
from hil_bridge.devices.robots.s3.link import S3Link
from hil_bridge.devices.robots.s3.orders_file import read_orders
from hil_bridge.devices.robots.s3.program_folder import read_programs
from hil_bridge.devices.robots.s3.settings import S3Settings
from hil_bridge.devices.robots.s3.status_faults import describe_stop
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.transports import LineSettings, Parity
from hil_bridge.transports.urls import CONNECT_BYTES, SERIAL_PORTS, parse_url, with_line
from protocol.devices.s3.adlp import LinkProfile
from protocol.devices.s3.arap import KNOWN, describe
from protocol.endpoint import Trouble
from protocol.robot import orientation_fault


def robot_wire(url: str, link: LinkProfile) -> tuple[str, LinkProfile]:
    """Return the robot URL and the profile with the same line settings. Settings that the URL does not contain are
    taken from the profile, all others from the URL. Raises ConfigError if a line setting is invalid.
    """
    parsed = parse_url(url, CONNECT_BYTES)
    options = parsed.options
    try:
        link = replace(
            link,
            baudrate=options.get("baudrate", link.baudrate),
            parity=Parity(options.get("parity", link.parity)).value,
            stop_bits=options.get("stopbits", link.stop_bits),
        )
    except ValueError as error:
        raise ConfigError(f"{url!r}: {error}") from error
    return (with_line(url, _line(link)) if parsed.scheme in SERIAL_PORTS else url), link


def _line(link: LinkProfile) -> LineSettings:
    return LineSettings(link.baudrate, Parity(link.parity), link.stop_bits)


def robot_site(settings: KindSettings[S3Settings, S3Profiles]) -> S3Site:
    """Read the controller's orders and programs from the files that a configuration names. Raises ConfigError if a
    file is invalid.
    """
    orders, programs = settings.client.orders_file, settings.emulated.robot.program_folder
    return S3Site(
        read_orders(Path(orders), settings.client.link.max_telegram) if orders else KNOWN,
        read_programs(Path(programs), settings.emulated.link.max_telegram) if programs else {},
    )


async def connect(url: str, settings: KindSettings[S3Settings, S3Profiles], wiring: Wiring) -> S3Link:
    """Connect to the controller on a byte wire, without starting the link.

    Raises ConfigError for an invalid URL or orders file, TransportUnavailable if the wire cannot be opened.
    """
    orders_file, link = settings.client.orders_file, settings.client.link
    orders = read_orders(Path(orders_file), link.max_telegram) if orders_file else KNOWN
    url, link = robot_wire(url, link)
    wire = await wiring.bytes(url)
    robot = S3Link(wire, link, wiring.clock, wiring.log, orders)
    robot.facts = robot_facts(link, settings.emulated.servo)
    return robot


async def probe(url: str, settings: KindSettings[S3Settings, S3Profiles], wiring: Wiring) -> ProbeResult:
    """Probe a controller with these link settings by reading its status only. Standby is not a refusal, because a
    run ends it automatically.
    """
    robot = await connect(url, settings, wiring)
    try:
        robot.start()
        status = await first_answer(robot.name, robot.read_status())
    finally:
        await robot.aclose()
    x, y, z = (1e3 * value for value in status.position)
    stopped = describe_stop(status, robot.profile.check_flags, standby=False)
    wrong = orientation_fault(status.quaternion)
    refusals = (
        *((Trouble(*stopped),) if stopped else ()),
        *((Trouble(f"it reports {wrong}"),) if wrong else ()),
    )
    return ProbeResult(
        (
            ("robot", robot.facts.model),
            ("position", f"{x:.1f} {y:.1f} {z:.1f} mm"),
            ("state", stopped[0] if stopped else "in operation" if status.operation else "in standby"),
        ),
        refusals,
    )


def facts(url: str, settings: KindSettings[S3Settings, S3Profiles]) -> RobotFacts:
    """Return the facts of a controller on this wire. The servo is assumed to equal the servo of the emulated
    controller.
    """
    link = robot_wire(url, settings.client.link)[1] if url else settings.client.link
    return robot_facts(link, settings.emulated.servo)


def make(settings: KindSettings[S3Settings, S3Profiles]) -> RobotFactory:
    """Return a factory of the controller that the configuration section of the cell describes, with the orders and
    programs of its site.
    """
    return make_robot(settings.emulated, robot_site(settings))


async def serve(
    url: str, robot: Any, settings: KindSettings[S3Settings, S3Profiles], serving: Serving
) -> str:
    """Let the emulated controller listen. A port in memory without line settings has the controller's settings."""
    line = _line(settings.emulated.link)
    unnamed = url.startswith("memory:") and "?" not in url  # the URL contains no line settings
    address = await serving.serve_bytes(with_line(url, line) if unnamed else url, robot.endpoint)
    return with_line(address, line) if unnamed else address


def usual(settings: KindSettings[S3Settings, S3Profiles], virtual: bool) -> str:
    """Return the default URL to listen on. In real time, it is a serial line like the line of the real controller."""
    return "memory:robot" if virtual else with_line("pty:", _line(settings.emulated.link))


MISHAPS = {"refused": "key-manual", "stopped": "safeguard-stop"}


def late(
    quantiles_ms: Mapping[str, Sequence[float]], url: str, settings: KindSettings[S3Settings, S3Profiles]
) -> LateSettings:
    """Return the settings for a controller with this latency on the recorded line. The line settings may come from
    the URL of the recorded run.
    """
    link = settings.client.link
    return LateSettings(NOTES, late_settings(quantiles_ms, robot_wire(url, link)[1] if url else link))


ROBOT = RobotKind(
    "s3",
    "ABB S3 controller by its computer link",
    S3Settings,
    connect,
    facts,
    RobotEmulation(
        S3Profiles, make, serve, usual, S3_FAULTS, S3_CONTROLS, MISHAPS, 200.0, match=match, late=late
    ),
    check=robot_site,
    parse=lambda url, settings: parse_url(url, CONNECT_BYTES),
    describe=describe,
    probe=probe,
    usual_wire="tcp://{host}:4000",
    ruling={
        Cause.ROBOT_NOT_READY: ("link.check_flags",),
        Cause.ROBOT_STATE: ("link.check_flags",),
        Cause.DEAD_LINK: ("link.answer_timeout_s", "link.order_timeout_s"),
    },
)
