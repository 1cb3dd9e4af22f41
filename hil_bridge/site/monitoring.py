"""What `hil-bridge monitor` hands to the device whose link it shows."""

from pathlib import Path
from typing import NamedTuple

from hil_bridge.settings.configuration import Config


class MonitorOptions(NamedTuple):
    """Options of `hil-bridge monitor`, for an extension `monitor-KIND`: a function of the sources and of these."""

    raw: bool
    """Whether the bytes are shown, too."""
    save: Path | None
    """File for a text capture of what is heard."""
    config: Config
    is_configured: bool
    """Whether a file gave the configuration, so that its link settings hold for a file, too."""
    orders_file: Path | None
