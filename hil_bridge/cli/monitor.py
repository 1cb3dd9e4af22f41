"""`hil-bridge monitor`: what goes over a link, in words."""

from pathlib import Path
from typing import Any

import click

from hil_bridge.console.paths import FILE


@click.command(short_help="Show a link, one line for each block.")
@click.argument("sources", metavar="FILE|URL [URL]", nargs=-1, required=True)
@click.option("--raw", is_flag=True, help="Also the bytes, hexadecimal.")
@click.option(
    "--device",
    type=click.Choice(["robot", "sensor", "both"]),
    help="Whose traffic of a recording to show.  [default: both; of a run with an S3: robot]",
)
@click.option("--save", type=FILE, metavar="FILE", help="Keep what is heard as a text capture.")
@click.option(
    "--config",
    "config_file",
    type=FILE,
    metavar="FILE",
    help="Configuration whose [robot.s3.link] holds, and whose sensor sent the frames of a log of candump.",
)
@click.option(
    "--orders", "orders_file", type=FILE, metavar="FILE", help="TOML file of orders that the site knows."
)
def monitor(
    sources: tuple[str, ...],
    raw: bool,
    device: Any,
    save: Path | None,
    config_file: Path | None,
    orders_file: Path | None,
) -> None:
    """Show a link as one line for each block: time, time since the line before, direction, time on the line, meaning.

    FILE is a recording of a run with any devices, or a text capture of an S3 with lines like `0.013402 S3 06`. Bytes
    of a device without words are shown hexadecimal. FILE may be a log of candump, of its console or of `candump -l`;
    with --config it is in the words of that sensor. Two URLs are two ports: the first hears the PC, the second the
    robot. One URL is a port that hears both. Each is named as the S3's, `s3+serial:///dev/ttyUSB0`. A URL
    `jr3+can+socketcan://can0` shows the frames of a JR3 gateway.
    Nothing is ever sent. Times are those at which the bytes were seen. In a recording, bytes from the PC are seen when
    they are handed to the port, before they are on the line.
    """
    from hil_bridge.devices.kinds import SENSORS, robot_of
    from hil_bridge.devices.robots.s3.orders_file import read_orders
    from hil_bridge.devices.robots.s3.room import ROBOT as S3
    from hil_bridge.devices.sensors.jr3.monitor import monitor_can
    from hil_bridge.errors import ConfigError
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.devices import sensor_in
    from hil_bridge.settings.kinds import settings_of
    from hil_bridge.site.s3.monitor import monitor_file, monitor_link
    from hil_bridge.site.traffic import (
        is_candump,
        is_recording,
        monitor_candump,
        monitor_traffic,
        recorded_robot,
    )
    from protocol.devices.s3.arap import KNOWN

    first = sources[0]
    if device and not (len(sources) == 1 and is_recording(Path(first))):
        raise ConfigError("--device chooses from a recording; name one")
    if (
        len(sources) == 1
        and is_recording(Path(first))
        and (device in ("sensor", "both") or recorded_robot(Path(first)) != "s3")
    ):
        monitor_traffic(Path(first), device or "both", raw)
        return
    config = load_config(config_file, {})
    if len(sources) == 1 and is_candump(Path(first)):
        sensor = sensor_in(config).kind if config_file else None
        if sensor is not None and sensor.bus is None:
            raise ConfigError(
                f"{first} has frames of CAN, and the sensor of {config_file} is a {sensor.name}"
            )
        monitor_candump(Path(first), sensor, raw)
        return
    settings = settings_of(config, S3).client
    link, file = settings.link, settings.orders_file
    named = orders_file or (Path(file) if file else None)
    orders = read_orders(named, link.max_telegram) if named else KNOWN
    if len(sources) == 1 and (Path(first).exists() or Path(first).suffix == ".mcap"):
        monitor_file(Path(first), link if config_file else None, orders, raw)
        return
    if SENSORS.split(first)[0] == "jr3":
        if len(sources) > 1:
            raise ConfigError("one CAN bus at a time: give one URL")
        monitor_can(SENSORS.split(first)[1], raw)
        return
    if len(sources) > 2:
        raise ConfigError("two URLs at most: what the PC sends and what the robot sends")
    wires = [robot_of(source) for source in sources]
    if other := next((kind for kind, _ in wires if kind is not S3), None):
        raise ConfigError(
            f"a link is heard of an s3, not of a {other.name}; record a run, and name the recording"
        )
    monitor_link(tuple(wire for _, wire in wires), link, orders, raw, save)
