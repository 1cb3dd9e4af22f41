"""Execution of the scenarios for sensor clients. The tool hangs freely, and loads are `offset` faults of the sensor
signal.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from emulators.faults.packets import SENSOR_WIRE
from hil_bridge.devices.kinds import SENSORS
from hil_bridge.errors import ConfigError
from hil_bridge.lab.conform.client import Client, Where
from hil_bridge.lab.conform.sensors.judging import judge, off_by
from hil_bridge.lab.conform.sensors.readings import Lines, Part, Reading, SensorEvidence, difference, mean_of
from hil_bridge.lab.conform.sensors.scenarios import LOST, RESTART, SENSOR_SCENARIOS, SensorRules
from hil_bridge.lab.conform.sensors.timeline import sensor_timeline
from hil_bridge.lab.conform.trial import (
    CUT,
    NOMINAL,
    Ended,
    InCell,
    Mishap,
    ScenarioResult,
    Scene,
    Trial,
    skip,
)
from hil_bridge.lab.conform.verdict import Outcome, Verdict
from hil_bridge.runs.compose import ServedCell
from hil_bridge.runs.setup import Listen
from hil_bridge.settings.devices import Sensor
from hil_bridge.show.pages.timeline import TimeLine
from protocol.wrench import AXES

_SIGNAL, _OFFSET = "signal", "offset"


@dataclass(frozen=True)
class SensorTrial(Trial[SensorEvidence]):
    """Conformance test of a force sensor client."""

    thing: ClassVar[str] = "sensor"
    meanings: ClassVar[Mapping[str, str]] = SENSOR_SCENARIOS
    rules: SensorRules

    @property
    def mishaps(self) -> dict[str, Mishap | None]:
        kind = SENSORS.kind(self.kind)
        faults = {} if kind.emulation is None else kind.emulation.faults
        if kind.emulation is None or _OFFSET not in faults.get(_SIGNAL, {}):
            raise ConfigError(
                f"{kind.name}: cannot test its clients, the emulator has no fault {_SIGNAL} {_OFFSET} to load an axis"
            )
        mishaps = {
            LOST: Mishap(SENSOR_WIRE, "lost", {"for_s": self.rules.watch_s, "way": "from"}),
            CUT: Mishap(SENSOR_WIRE, "off", {"for_s": self.rules.cut_s}),
            RESTART: Mishap("sensor", "power-cycle"),
            **{
                name: Mishap("sensor", fault, {"for_s": self.rules.watch_s})
                for name, fault in kind.emulation.mishaps.items()
            },
        }
        return self._possible(mishaps, faults)

    @property
    def listen(self) -> Listen:
        return Listen(None, self.port)

    def device_of(self, served: ServedCell) -> Sensor:
        assert served.sensor is not None
        return served.sensor

    def scene(self, name: str, in_cell: InCell, client: Client) -> Scene[SensorEvidence]:
        return _SensorScene(name, self, in_cell, client)

    def judge(self, name: str, evidence: SensorEvidence) -> Verdict:
        return judge(name, evidence, self.rules)

    def timeline(self, name: str, evidence: SensorEvidence) -> TimeLine:
        return sensor_timeline(name, evidence, self.rules)

    def refuse(
        self, name: str, nominal: ScenarioResult[SensorEvidence]
    ) -> ScenarioResult[SensorEvidence] | None:
        if nominal.verdict.outcome is Outcome.PASSED or nominal.seen.first_at is not None:
            return None
        return skip(name, self, "the client reported no reading without a fault", SensorEvidence())


class _SensorScene(Scene[SensorEvidence]):
    """Scenario for a sensor client while it is executed."""

    def __init__(self, name: str, trial: SensorTrial, in_cell: InCell, client: Client) -> None:
        super().__init__(SensorEvidence(), in_cell, client, trial.rules.end_s)
        self._name, self._rules, self._mishap = name, trial.rules, trial.mishaps[name]
        self._lines = Lines()
        client.on_output = self._on_output

    async def play(self, where: Where) -> None:
        """Run the scenario: start the client, apply the loads or inject the fault, and end the client."""
        await self._clock.sleep_until(self._begun + self._rules.powered_s)
        self._check()
        self._client.start(where)
        with suppress(Ended):
            await self._course()
        await self._end_client()
        self.seen.no_numbers = self._lines.no_numbers

    async def _course(self) -> None:
        rules, evidence = self._rules, self.seen
        await self._until(lambda: evidence.first_at is not None, rules.start_s)
        if evidence.first_at is None:
            return
        begin = self._since()
        await self._until(None, rules.settle_s)
        now = self._clock.now()
        fx, fy, fz, mx, my, mz = self._cell.wrench(np.array([now]))[0].tolist()
        evidence.truth = (fx, fy, fz, mx, my, mz)
        # The first readings may precede the client's own zero.
        at_rest = Part(begin + rules.settle_s / 2.0, self._since())
        evidence.at_rest = mean_of(self._lines.during(at_rest))
        if self._name == NOMINAL:
            await self._load()
        elif self._mishap is not None:
            await self._break(self._mishap)

    async def _load(self) -> None:
        """Apply a load to one axis after the other, and store the change of the reading."""
        rules, evidence = self._rules, self.seen
        for number, axis in enumerate(AXES):
            amount = rules.force_n if number < 3 else rules.moment_nm
            load = Mishap(_SIGNAL, _OFFSET, {"axis": axis, "amount": amount, "for_s": rules.load_s})
            begin = self._since()
            evidence.loaded_at.append(begin)
            self._strike(load)
            await self._until(None, rules.load_s)
            loaded = mean_of(self._lines.during(Part(begin + rules.react_s, begin + rules.load_s)))
            known = loaded is not None and evidence.at_rest is not None
            evidence.loads.append((axis, difference(loaded, evidence.at_rest) if known else None))  # type: ignore[arg-type]

    async def _break(self, mishap: Mishap) -> None:
        """Inject the fault, and evaluate the readings after it."""
        rules, evidence = self._rules, self.seen
        last = self._lines.readings[-1]
        evidence.fault_at, evidence.last_before_fault_at = self._since(), last.at
        self._strike(mishap)
        fault_s = rules.cut_s if self._name == CUT else 0.0 if self._name == RESTART else rules.watch_s
        try:
            await self._until(None, fault_s)
        finally:
            behind = self._lines.during(Part(evidence.fault_at + rules.react_s, evidence.fault_at + fault_s))
            evidence.behind_fault = len(behind)
            evidence.behind_at = behind[0].at if behind else None
            evidence.same_behind_fault = sum(one.wrench == last.wrench for one in behind)
            self._note_worst(behind)
        if self._name not in (CUT, RESTART):
            return
        evidence.returned_at = self._since()
        # Readings from before the fault may still be in transit: they do not count as a return.
        since = evidence.fault_at + rules.react_s if self._name == RESTART else evidence.returned_at
        await self._until(lambda: self._note_return(since), rules.back_s)
        if evidence.back_at is None:
            return
        await self._until(None, 2.0 * rules.react_s)
        evidence.at_end = mean_of(self._lines.during(Part(evidence.back_at + rules.react_s, self._since())))

    def _note_return(self, since: float) -> bool:
        """Record the time of the first reading after a cut, or after the silence of a restart; return whether there
        is one.
        """
        newest = self._lines.readings[-1]
        if newest.at >= since and self.seen.back_at is None:
            self.seen.back_at = newest.at
        return self.seen.back_at is not None

    def _note_worst(self, behind: Sequence[Reading]) -> None:
        evidence = self.seen
        at_rest = evidence.at_rest
        if at_rest is not None and behind:
            worst = max(behind, key=lambda one: off_by(one.wrench, at_rest, self._rules))
            evidence.worst, evidence.worst_at = worst.wrench, worst.at

    def _on_output(self, piece: bytes) -> None:
        """Parse a piece of the client's output."""
        lines, evidence, at = self._lines, self.seen, self._since()
        lines.take(piece, at)
        if lines.readings:
            evidence.readings = len(lines.readings)
            evidence.first_at, evidence.last_at = lines.readings[0].at, lines.readings[-1].at
