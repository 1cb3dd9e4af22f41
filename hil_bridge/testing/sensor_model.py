"""Stateful model of a force sensor: after any sequence of loads and zeros, client and model must report the same
wrench.
"""

from hypothesis import strategies as st
from hypothesis.stateful import rule

from hil_bridge.clock import Clock
from hil_bridge.testing.cases import SensorCase
from hil_bridge.testing.model import Model, try_sequences
from hil_bridge.testing.naming import Finding, wrench_mistake
from hil_bridge.testing.sensor_rig import NOTHING, SensorRig, full_scales, sensor_rig

EXAMPLES = 3
"""Number of sequences to try. Every run tries the same sequences. Chosen."""
STEPS = 8
"""Maximum number of steps in a sequence. Chosen."""
_shares = st.tuples(*[st.integers(-30, 30)] * 6)
"""Strategy for loads, in percent of the range of each axis."""


class SensorModel(Model):
    """Model of the sensor: frames report the present load minus the load at the time of zeroing."""

    case: SensorCase

    def __init__(self) -> None:
        super().__init__()
        self.pushed: tuple[float, ...] = NOTHING
        self.run(self._begin())

    async def _begin(self) -> None:
        self.rig: SensorRig = await self._stack.enter_async_context(sensor_rig(self.case, Clock.running()))
        self.sensor = await self._stack.enter_async_context(self.rig.started())
        facts = self.sensor.facts
        self.full = full_scales(self.case, facts)
        self.allowed = [2.0 * self.case.noise * one for one in self.full]
        reported = await self.rig.settled(self.sensor)
        self.zero = tuple(-one for one in reported)

    @rule(shares=_shares)
    def push(self, shares: tuple[int, ...]) -> None:
        self.pushed = tuple(0.01 * share * one for share, one in zip(shares, self.full, strict=True))
        self.rig.push(self.pushed)
        self._check()

    @rule()
    def take_zero(self) -> None:
        self.run(self.rig.wait(self.case.settle_s))
        self.run(self.rig.within(self.sensor.tare(), "zero"))
        self.zero = self.pushed
        self._check()

    @rule()
    def pull_the_cable_for_a_moment(self) -> None:
        for wire in self.rig.wires:
            wire.cut = True
        self.run(self.rig.wait(0.03))
        for wire in self.rig.wires:
            wire.cut = False
        self._check()

    def _check(self) -> None:
        reported = self.run(self.rig.settled(self.sensor))
        expected = [a - b for a, b in zip(self.pushed, self.zero, strict=True)]
        if mistake := wrench_mistake(reported, expected, self.allowed):
            raise Finding(mistake)

    def teardown(self) -> None:
        self.end(self._stack.aclose())


def check_any_push(case: SensorCase) -> None:
    """Try sequences of loads. A failing sequence is reported in its shortest form."""
    try_sequences(SensorModel, case, EXAMPLES, STEPS)
