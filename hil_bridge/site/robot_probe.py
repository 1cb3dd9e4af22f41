"""`hil-bridge probe robot` of every kind: what answers there, and what a run would be refused for. It moves nothing."""

from typing import Any

from hil_bridge.clock import Clock, run_real
from hil_bridge.devices.device_log import Silence
from hil_bridge.devices.kinds import KindSettings, RobotKind
from hil_bridge.devices.robots.probing import Probed
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import ConfigError


def probe_robot(kind: RobotKind[Any, Any], wire: str, settings: KindSettings[Any, Any]) -> Probed:
    """Probe in real time; a run would begin where nothing is refused.

    Raises ConfigError for a kind without a probe, TransportUnavailable for the wire, DeviceError where nothing answers.
    """

    async def main() -> Probed:
        clock = Clock.running()
        try:
            return await probe(kind, wire, settings, clock)
        finally:
            clock.close()

    return run_real(main)


async def probe(
    kind: RobotKind[Any, Any], wire: str, settings: KindSettings[Any, Any], clock: Clock
) -> Probed:
    """Findings of the robot behind a wire. Errors as of `probe_robot`."""
    if kind.probe is None:
        raise ConfigError(
            f"a robot of the kind {kind.name} has no probe; its package gives one as `probe` of its RobotKind"
        )
    found: Probed = await kind.probe(wire, settings, Wiring("robot", clock, Silence()))
    return found


def probe_values(found: Probed) -> dict[str, object]:
    """The same as values."""
    return {
        "would_begin": not found.refusals,
        "rows": [{"name": name, "text": text} for name, text in found.rows],
        "refusals": [{"fact": trouble.fact, "remedy": trouble.remedy} for trouble in found.refusals],
    }


def probe_rows(found: Probed) -> list[tuple[str, str]]:
    """All findings, and at the end what a run would meet."""
    refusals = [("a run", f"would be refused: {trouble}") for trouble in found.refusals]
    return [*found.rows, *(refusals or [("a run", "would begin, as far as the robot tells")])]
