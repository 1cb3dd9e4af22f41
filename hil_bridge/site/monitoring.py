"""Options that `hil-bridge monitor` passes to the device whose link it shows."""

from pathlib import Path
from typing import NamedTuple

from hil_bridge.settings.configuration import Config


class MonitorOptions(NamedTuple):
    """Options of `hil-bridge monitor`, for an extension `monitor-KIND`: a function of the sources and of these."""

    raw: bool
    """Whether to show the bytes, too."""
    save: Path | None
    """File for a text capture of received traffic."""
    config: Config
    is_configured: bool
    """Whether a file gave the configuration, so that its link settings hold for a file, too."""
    orders_file: Path | None
