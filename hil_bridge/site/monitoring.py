"""Options that `hil-bridge monitor` passes to the device package whose link it displays."""

from pathlib import Path
from typing import NamedTuple

from hil_bridge.settings.configuration import Config


class MonitorOptions(NamedTuple):
    """Options of `hil-bridge monitor`. An extension `monitor-KIND` is a function of the sources and these options."""

    raw: bool
    """Whether to display the bytes as well."""
    save: Path | None
    """File for a text capture of the received traffic."""
    config: Config
    is_configured: bool
    """Whether the configuration comes from a file, so that its link settings also apply to a capture file."""
    orders_file: Path | None
