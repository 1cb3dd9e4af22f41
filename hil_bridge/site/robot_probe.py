"""Implementation of `hil-bridge probe robot` for every kind: what responds, and why a run would be refused. Nothing
moves.
"""

from typing import Any

from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.kinds import KindSettings, RobotKind
from hil_bridge.devices.robots.probe import ProbeResult
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import harmless, toml_pair

FOUND = (
    "# Found by `hil-bridge probe robot`; all other settings have their defaults. Lines beginning with #= are settings",
    "# that a probe cannot find: remove #= and set them. Then `hil-bridge doctor` reports whether a run could start.",
    "",
    "[robot]",
)
"""Heading of the file that a probe writes."""
TO_FILL_IN = """
[sensor]
# URL of the force sensor: jr3+can+slcan:///dev/ttyACM0?bitrate=1000000, jr3-uart+serial:///dev/ttyACM0,
# netft+udp://192.168.1.1:49152, ft300+serial:///dev/ttyUSB0
#= url = "jr3+can+socketcan://can0"
# its mounting in the tool frame; `hil-bridge probe sensor URL` determines it from pushes by hand
#= mounting_deg = 0.0
#= flip_fx_mx = false

[tool]
# load below the sensor; `hil-bridge identify tool` measures it
#= mass_kg = 0.5
#= centre_of_gravity_mm = [0.0, 0.0, 0.0]

[frame]
# into the surface and along it, in the robot's base frame
#= approach = [0.0, 0.0, -1.0]
#= travel = [0.0, 1.0, 0.0]

[task]
#= force_n = 10.0
# of the hardest surface that the tool may touch; it limits the speed of the approach
#= expected_stiffness_n_m = 5000.0

[limits]
#= force_limit_n = 50.0
# corners of the permitted workspace, in the robot's base frame
#= workspace_min_m = [-3.0, -3.0, -3.0]
#= workspace_max_m = [3.0, 3.0, 3.0]
"""
"""Settings that only the operator knows, with their defaults."""


def probe_robot(kind: RobotKind[Any, Any], wire: str, settings: KindSettings[Any, Any]) -> ProbeResult:
    """Probe a robot in real time. If the result contains no refusals, a run could start.

    Raises ConfigError if the kind has no probe, TransportUnavailable if the wire cannot be opened, DeviceError if
    the robot does not respond.
    """

    async def main() -> ProbeResult:
        clock = Clock.running()
        try:
            return await probe(kind, wire, settings, clock)
        finally:
            clock.close()

    return run_real(main)


async def probe(
    kind: RobotKind[Any, Any], wire: str, settings: KindSettings[Any, Any], clock: Clock
) -> ProbeResult:
    """Probe the robot on a wire. Errors as for `probe_robot`."""
    if kind.probe is None:
        raise ConfigError(
            f"the kind {kind.name} has no probe; its package provides one as `probe` of its RobotKind"
        )
    result: ProbeResult = await kind.probe(wire, settings, Wiring("robot", clock, NullLog()))
    return result


def probe_values(result: ProbeResult) -> dict[str, object]:
    """Return the result as a dictionary of plain values."""
    return {
        "would_begin": not result.refusals,
        "rows": [{"name": name, "text": text} for name, text in result.rows],
        "refusals": [{"fact": trouble.fact, "remedy": trouble.remedy} for trouble in result.refusals],
    }


def probe_rows(result: ProbeResult) -> list[tuple[str, str]]:
    """Return all findings as rows; the last row says whether a run would be refused."""
    refusals = [("a run", f"would be refused: {trouble}") for trouble in result.refusals]
    return [*result.rows, *(refusals or [("a run", "would begin, as far as the robot reports")])]


def site_toml(url: str, result: ProbeResult) -> str:
    """Return a configuration file with the robot's URL. The findings and the operator's settings are comments."""
    rows = [f"# {name}: {harmless(' '.join(text.split()))}" for name, text in result.rows]
    return "\n".join([*FOUND, *rows, toml_pair("url", url)]) + "\n" + TO_FILL_IN
