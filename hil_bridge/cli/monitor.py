"""`hil-bridge monitor`: display the decoded traffic of a link."""

from pathlib import Path
from typing import Any

import click

from hil_bridge.cli.entry_points import EXTENSIONS, extension
from hil_bridge.console.paths import FILE

_OTHERWISE = "monitor-s3"
"""Extension for all sources that do not name another device: text captures, and the links of robots."""


@click.command(short_help="Monitor a link, one line per block.")
@click.argument("sources", metavar="FILE|URL [URL]", nargs=-1, required=True)
@click.option("--raw", is_flag=True, help="Also print the bytes in hexadecimal.")
@click.option(
    "--device",
    type=click.Choice(["robot", "sensor", "both"]),
    help="Device of a recording whose traffic to show.  [default: both; for a run with an S3: robot]",
)
@click.option("--save", type=FILE, metavar="FILE", help="Write received traffic to FILE as a text capture.")
@click.option(
    "--config",
    "config_file",
    type=FILE,
    metavar="FILE",
    help="Configuration with [robot.s3.link], and with the sensor that sent the frames of a candump log.",
)
@click.option(
    "--orders", "orders_file", type=FILE, metavar="FILE", help="TOML file of orders used at this site."
)
def monitor(
    sources: tuple[str, ...],
    raw: bool,
    device: Any,
    save: Path | None,
    config_file: Path | None,
    orders_file: Path | None,
) -> None:
    """Show a link as one line per block: time, time since the last line, direction, time on the line, meaning.

    FILE is a recording of a run with any devices, or a text capture of an S3 with lines like `0.013402 S3 06`. Bytes
    of a device without a decoder are shown in hexadecimal. FILE may be a candump log, from its console or `candump -l`;
    with --config it is decoded as that sensor's. Two URLs are two ports: the first receives the PC, the second the
    robot. One URL is a port that receives both. Each is named as the S3's, `s3+serial:///dev/ttyUSB0`. A URL
    `jr3+can+socketcan://can0` shows the frames of a JR3 gateway.
    Nothing is ever sent. Times are those of reception. In a recording, bytes from the PC have the time at which
    they were handed to the port, before they are on the line.
    """
    from hil_bridge.devices.kinds import SENSORS
    from hil_bridge.errors import ConfigError
    from hil_bridge.errors.plugins import plugin_names
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.settings.devices import sensor_in
    from hil_bridge.site.monitoring import MonitorOptions
    from hil_bridge.site.traffic import (
        is_candump,
        is_recording,
        monitor_candump,
        monitor_traffic,
        recorded_robot,
    )

    first = sources[0]
    if device and not (len(sources) == 1 and is_recording(Path(first))):
        raise ConfigError("--device applies only to a recording; name one")
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
                f"{first} has CAN frames, but the sensor of {config_file}, {sensor.name}, is not on CAN"
            )
        monitor_candump(Path(first), sensor, raw)
        return
    kind = SENSORS.split(first)[0]
    listener = f"monitor-{kind}" if f"monitor-{kind}" in plugin_names(EXTENSIONS) else _OTHERWISE
    options = MonitorOptions(raw, save, config, config_file is not None, orders_file)
    extension(listener, "monitor")(sources, options)
