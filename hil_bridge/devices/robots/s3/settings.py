"""Client settings of an S3 controller and its computer link."""

from dataclasses import dataclass, field

from protocol.devices.s3.adlp import LinkProfile


@dataclass(frozen=True, slots=True)
class S3Settings:
    """Settings in the section `[robot.s3]`."""

    orders_file: str = ""
    """TOML file with further orders of this controller, in addition to the known orders; empty for none."""
    link: LinkProfile = field(default_factory=LinkProfile)
    """Known and assumed settings of the computer link."""
