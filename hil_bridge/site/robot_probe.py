"""`hil-bridge probe robot` of every kind: what answers there, and what a run would be refused for. It moves nothing."""

from typing import Any

from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.kinds import KindSettings, RobotKind
from hil_bridge.devices.robots.probe import ProbeResult
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import harmless, toml_pair

FOUND = (
    "# Found by `hil-bridge probe robot`; what is not here has its default. The lines that begin with #= are what",
    "# no probe can find: take #= away and set them. Then `hil-bridge doctor` tells whether a run would begin.",
    "",
    "[robot]",
)
"""Head of the file that a probe writes."""
TO_FILL_IN = """
[sensor]
# where the force sensor is: jr3+can+slcan:///dev/ttyACM0?bitrate=1000000, jr3-uart+serial:///dev/ttyACM0,
# netft+udp://192.168.1.1:49152, ft300+serial:///dev/ttyUSB0
#= url = "jr3+can+socketcan://can0"
# how it sits in the tool frame; `hil-bridge probe sensor URL` names its axes from a push by hand
#= mounting_deg = 0.0
#= flip_fx_mx = false

[tool]
# what hangs below the sensor; `hil-bridge identify tool` measures it
#= mass_kg = 0.5
#= centre_of_gravity_mm = [0.0, 0.0, 0.0]

[frame]
# into the surface and along it, in the robot's base frame
#= approach = [0.0, 0.0, -1.0]
#= travel = [0.0, 1.0, 0.0]

[task]
#= force_n = 10.0
# of the hardest thing that the tool may touch; the approach takes its speed from it
#= expected_stiffness_n_m = 5000.0

[limits]
#= force_limit_n = 50.0
# corners of the box that the tool may be in, in the robot's base frame
#= workspace_min_m = [-3.0, -3.0, -3.0]
#= workspace_max_m = [3.0, 3.0, 3.0]
"""
"""Facts that only an operator knows, with the defaults."""


def probe_robot(kind: RobotKind[Any, Any], wire: str, settings: KindSettings[Any, Any]) -> ProbeResult:
    """Probe in real time; a run would begin where nothing is refused.

    Raises ConfigError for a kind without a probe, TransportUnavailable for the wire, DeviceError where nothing answers.
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
    """Probe the robot behind a wire. Errors as of `probe_robot`."""
    if kind.probe is None:
        raise ConfigError(
            f"the kind {kind.name} has no probe; its package provides one as `probe` of its RobotKind"
        )
    found: ProbeResult = await kind.probe(wire, settings, Wiring("robot", clock, NullLog()))
    return found


def probe_values(found: ProbeResult) -> dict[str, object]:
    """Return the same as values."""
    return {
        "would_begin": not found.refusals,
        "rows": [{"name": name, "text": text} for name, text in found.rows],
        "refusals": [{"fact": trouble.fact, "remedy": trouble.remedy} for trouble in found.refusals],
    }


def probe_rows(found: ProbeResult) -> list[tuple[str, str]]:
    """All findings, and at the end what a run would meet."""
    refusals = [("a run", f"would be refused: {trouble}") for trouble in found.refusals]
    return [*found.rows, *(refusals or [("a run", "would begin, as far as the robot reports")])]


def site_toml(url: str, found: ProbeResult) -> str:
    """Return a configuration file with the robot's URL; findings, and what an operator must know, are comments."""
    rows = [f"# {name}: {harmless(' '.join(text.split()))}" for name, text in found.rows]
    return "\n".join([*FOUND, *rows, toml_pair("url", url)]) + "\n" + TO_FILL_IN
