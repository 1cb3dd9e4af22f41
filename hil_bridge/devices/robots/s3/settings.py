"""Settings of an S3 controller and its computer link, as the bridge sees them."""

from dataclasses import dataclass, field

from protocol.devices.s3.adlp import LinkProfile


@dataclass(frozen=True, slots=True)
class S3Settings:
    """Settings in `[robot.s3]`."""

    orders_file: str = ""
    """TOML file of orders that this controller knows beside the usual ones; empty: none."""
    link: LinkProfile = field(default_factory=LinkProfile)
    """Known and assumed facts about the computer link."""
