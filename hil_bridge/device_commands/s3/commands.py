"""Commands for the S3: `hil-bridge decode computer-link`, and the values of `--link-profile`."""

from collections.abc import Sequence
from pathlib import Path

import click

from hil_bridge.console.decode_arguments import print_items, read_bytes
from hil_bridge.console.paths import FILE


@click.command("computer-link", short_help="Decode bytes of the S3 computer link.")
@click.argument("hex_bytes", metavar="HEX…", nargs=-1, required=True)
@click.option(
    "--orders",
    "orders_file",
    type=FILE,
    metavar="FILE",
    help="TOML file of the site's additional orders.",
)
def computer_link(hex_bytes: tuple[str, ...], orders_file: Path | None) -> None:
    """Decode bytes of the S3 computer link, control bytes and blocks mixed.

    HEX may be spaced as you like: "10 02 00 08 01 00 13 01 00 00 10 03 18" or 100200…
    Exits with code 2 if anything in it is invalid.
    """
    from protocol.devices.s3.adlp import LinkProfile
    from protocol.devices.s3.arap import KNOWN, describe

    raw = read_bytes(hex_bytes)
    longest, orders = LinkProfile().max_telegram, KNOWN
    if orders_file is not None:
        from hil_bridge.devices.robots.s3.orders_file import read_orders

        orders = read_orders(orders_file, longest)
    print_items(describe(raw, max_telegram=longest, orders=orders))


def link_profiles() -> Sequence[str]:
    """Return the names of the settings that `--link-profile` accepts."""
    from protocol.devices.s3.adlp import PROFILES

    return tuple(PROFILES)


def check_link_profile(name: str) -> None:
    """Raise ConfigError that lists the known names if the name is unknown."""
    from hil_bridge.errors import ConfigError
    from protocol.devices.s3.adlp import settings_of_profile

    try:
        settings_of_profile(name)
    except ValueError as error:
        raise ConfigError(f"--link-{error}") from error
