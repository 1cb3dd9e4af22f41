"""Settings of an emulated SCHUNK FTS."""

from dataclasses import dataclass

from emulators.sensing import settings as errors
from emulators.sensing.settings import PerAxis, SensorErrorSettings, check_errors
from hil_schunk.messages import DATA_PORT, TOOLS, ErrorCode
from protocol.geometry import Vector
from protocol.marks import Mark, SettingError, above, at_least, between, check_settings, setting

_NO_POINT: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class FtsProfile(SensorErrorSettings):
    """Settings in `[cell.schunk_fts]`. The maker publishes no figures of the sensor with the library, so that those
    of the signal are assumed.
    """

    ratings_n: Vector = setting(
        (500.0, 500.0, 500.0), Mark.ASSUMED, "range of fx fy fz; differs by sensor", above(0.0), unit="N"
    )
    ratings_nm: Vector = setting(
        (20.0, 20.0, 20.0), Mark.ASSUMED, "range of mx my mz; differs by sensor", above(0.0), unit="N·m"
    )
    resolution_n: float = setting(0.01, Mark.ASSUMED, "step of the reported forces", above(0.0), unit="N")
    resolution_nm: float = setting(
        0.0005, Mark.ASSUMED, "step of the reported moments", above(0.0), unit="N·m"
    )
    overload_share: float = setting(
        1.2, Mark.ASSUMED, "fraction of the range at which values are clipped", between(1.0, 10.0)
    )
    noise_n: PerAxis = setting(0.05, Mark.ASSUMED, *errors.NOISE_N)
    noise_nm: PerAxis = setting(0.002, Mark.ASSUMED, *errors.NOISE_NM)
    product_name: str = setting("FTS", Mark.OBSERVED, "product name, as the maker's tests require it")
    product_number: str = setting("", Mark.ASSUMED, "product number, as text")
    firmware: str = setting("emulated", Mark.CHOSEN, "version of the firmware")
    data_port: int = setting(
        DATA_PORT, Mark.OBSERVED, "UDP port of the client to which it sends", between(1, 65535)
    )
    clients: int = setting(
        8,
        Mark.ASSUMED,
        "connections at a time; the maker's tests mention a limit without its value",
        at_least(1),
    )
    boot_s: float = setting(
        5.0,
        Mark.DERIVED,
        "time without answer after a reset: the maker's tests wait so long",
        between(0.0, 60.0),
        unit="s",
    )
    warm_up_s: float = setting(
        0.5, Mark.ASSUMED, "time after the boot during which it is not ready", between(0.0, 60.0), unit="s"
    )
    latency_s: float = setting(
        0.0003, Mark.ASSUMED, "time from a sample to its packet", between(0.0, 0.1), unit="s"
    )
    parameter_error: int = setting(
        int(ErrorCode.OUT_OF_RANGE),
        Mark.ASSUMED,
        "error of the answer for an unknown parameter, and for a write, which needs rights",
        between(1, 255),
    )
    overload_clears_ready: bool = setting(True, Mark.ASSUMED, "a mechanical overload clears the bit ready")
    stops_with_connection: bool = setting(
        True, Mark.ASSUMED, "the stream ends with the connection that has started it"
    )
    tare_persistent: bool = setting(False, Mark.ASSUMED, "a tare persists after a reset")
    tool_points_mm: tuple[Vector, ...] = setting(
        (_NO_POINT,) * TOOLS,
        Mark.ASSUMED,
        "point of each tool setting about which moments are reported",
        unit="mm",
    )
    tool_limits_n: tuple[float, ...] = setting(
        (0.0,) * TOOLS,
        Mark.ASSUMED,
        "largest force of each tool setting; 0: no limit",
        at_least(0.0),
        unit="N",
    )
    tool_limits_nm: tuple[float, ...] = setting(
        (0.0,) * TOOLS,
        Mark.ASSUMED,
        "largest moment of each tool setting; 0: no limit",
        at_least(0.0),
        unit="N·m",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        check_errors(self)
        for name in ("tool_points_mm", "tool_limits_n", "tool_limits_nm"):
            if len(getattr(self, name)) != TOOLS:
                raise SettingError(name, f"must have {TOOLS} entries, got {len(getattr(self, name))}")
        for name in ("ratings_n", "ratings_nm"):
            if len(getattr(self, name)) != 3:
                raise SettingError(name, f"must be three values, got {len(getattr(self, name))}")
