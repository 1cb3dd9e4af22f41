"""A hundred runs, each with a fault at some moment, a controller, a stiffness and a shape drawn by its seed.

Every draw must keep these promises. The true force stays within its bound, and no order goes deeper after a stop. The
run ends in time and with a cause that fits the injected faults. Its recording is whole and replayed alike, and no run
that ends pressing has completed. Set HIL_BRIDGE_SEEDS to 10000 for a night.
"""

import asyncio
import contextlib
import io
import itertools
import math
import os
import random
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from emulators.cell_faults import CELL_FAULTS
from emulators.s3_jr3_cell import PaperCell
from hil_bridge.clock import Clock
from hil_bridge.control import CONTROLLERS
from hil_bridge.errors import BridgeError
from hil_bridge.recording import Recording, read
from hil_bridge.runs.compose import make_cell
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.replay import replay
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import Config

SEEDS = int(os.environ.get("HIL_BRIDGE_SEEDS", "100"))
BLOCK = 20
LIMIT_N = 50.0
LATENCY_CYCLES = 3
"""Cycles from an order to the force that shows its effect: answer, motion, filter, and the cycle that sees it."""
LONGEST_S = 400.0
"""A run of two seconds of tracking, with all the patience that it has with robot and sensor."""
WATCH_S, WATCH_FRAMES = 0.2, 20
"""The truth is looked at every 10 ms, 20 times at once."""
HARD_N_M = 1e4
"""Stiffness from which a controller that was tuned for a sponge may hit."""
PHASES = ("connect", "tare", "approach", "track", "retract")

PARAMETERS: dict[tuple[str, str], dict[str, Any]] = {
    ("pose", "encoder-offset"): {"z_mm": 2.0},
    ("pose", "offset"): {"z_mm": 200.0},
    ("pose", "drift"): {"z_mm_s": 20.0},
    ("link", "off"): {"for_s": 60.0},
    ("frames", "off"): {"for_s": 60.0},
    ("frames", "unplugged"): {"for_s": 60.0},
    ("robot", "silence"): {"for_s": 60.0},
    ("computer", "pause"): {"seconds": 2.0},
    ("surface", "hard"): {"factor": 2.0},
}
"""Settings that are not at their defaults."""

BEFORE = ("connect", "tare")
SEEN_BY_WEIGHT = {
    ("signal", "dead"), ("signal", "scale"), ("signal", "offset"), ("signal", "sign"), ("signal", "swapped"),
    ("scales", "wrong"),
}  # fmt: skip
"""Faults of the axis that the tool's weight lies on: found before anything moves."""
LYING = SEEN_BY_WEIGHT | {
    ("signal", "drift"), ("signal", "turned"), ("signal", "intermittent"), ("signal", "noise"),
    ("signal", "spike"), ("signal", "stuck"),
}  # fmt: skip
"""A sensor that lies once it has been checked: the guard sees what it is told, and no bound of the force holds."""
MOVES_ITSELF = {("surface", "step"), ("surface", "rises"), ("surface", "swings"), ("surface", "hard"),
                ("obstacle", "above"), ("pose", "encoder-offset")}  # fmt: skip
"""Presses by itself, however the tool stands still."""

FITTING = {
    "robot": r"robot on|refused|the reported position|computer",
    "pose": r"report|robot on|commanded|jumped|tool's weight|force stayed|no contact found|contact force|touching|away",
    "link": r"robot on",
    "signal": r"Fz|force|sensor|zero|contact|surface|moment|drifts|Fx",
    "scales": r"tool's weight|force|zero",
    "frames": r"sensor|force|frame|moment",
    "bus": r"sensor|force is|no new force|frame",
    "surface": r"force|contact|surface|moment|touching|away|pressing|left after|rest",
    "obstacle": r"force|contact|touching|away|left after|rest|weight",
    "computer": r"computer|force is|no new force",
}
"""Words that the cause of a stop may hold, by the target of the fault."""


@dataclass
class Drawn:
    """One seed: what it draws and what came of it."""

    seed: int
    target: str
    fault: str
    phase: str
    stiffness: float
    config: Config
    truths: list[tuple[float, float]] = field(default_factory=list)
    """Time, s, and the largest true contact force since the one before, N."""
    goals: list[tuple[float, float]] = field(default_factory=list)
    """Time, s, and the height that the robot was last ordered to, m."""
    cell: PaperCell | None = None
    began: float = 0.0
    said: str = ""

    @classmethod
    def of(cls, seed: int) -> "Drawn":
        draw = random.Random(seed)
        kinds = [(target, name) for target, faults in CELL_FAULTS.items() for name in faults]
        target, fault = kinds[seed % len(kinds)]
        phase = draw.choice(PHASES)
        stiffness = 10 ** draw.uniform(math.log10(500.0), math.log10(80e3))
        parameters = dict(PARAMETERS.get((target, fault), {}))
        where = {"for_s": parameters.pop("for_s")} if "for_s" in parameters else {}
        row = {"on": target, "fault": fault, "phase": phase, "with": parameters, **where}
        row["after_s"] = draw.uniform(0.0, 0.5 if phase in BEFORE else 1.5)
        shape = draw.choice(
            (
                {"kind": "flat"},
                {"kind": "sloped", "slope_deg": draw.uniform(-5.0, 5.0)},
                {"kind": "sinusoidal", "amplitude_mm": 3.0, "period_mm": 150.0, "origin_y_mm": -100.0},
                {"kind": "circular_arc", "radius_mm": 300.0, "origin_y_mm": -100.0},
            )
        )
        config = Config.model_validate(
            {
                "run": {"duration_s": 2.0, "seed": seed},
                "sensor": {"emulated": "board" if fault == "unplugged" else "gateway"},
                "controller": {"name": draw.choice(sorted(CONTROLLERS))},
                "task": {"expected_stiffness_n_m": max(stiffness, 2e3), "retract_mm": 5.0},
                "cell": {
                    "surface": {"stiffness_n_m": stiffness, **shape},
                    "start_position_mm": (900.0, -100.0, 600.0 + draw.uniform(-1.0, 1.0)),
                },
                "faults": [row],
            }
        )
        return cls(seed, target, fault, phase, stiffness, config)

    @property
    def kind(self) -> tuple[str, str]:
        return self.target, self.fault

    @property
    def bound(self) -> float:
        """Largest true force that may come of what was ordered: the limit, and what is under way."""
        return LIMIT_N + self.stiffness * self.config.task.single_step_mm * 1e-3 * LATENCY_CYCLES

    def hits(self, cause: str) -> bool:
        """A hard surface may be hit, or swung upon, without any fault."""
        return self.stiffness > HARD_N_M and bool(re.search("is beyond|swinging|contact lost", cause))

    def __call__(self, path: Path) -> tuple[int, Recording | None]:
        """Run it, and watch it; exit code, and what was recorded of cycles."""
        self.truths.clear()

        def watched(*arguments: Any) -> PaperCell:
            cell = self.cell = make_cell(*arguments)
            clock = Clock(asyncio.get_running_loop())
            self.began = clock.now()

            def look() -> None:
                now = clock.now()
                times = now - WATCH_S + np.arange(1.0, WATCH_FRAMES + 1.0) * (WATCH_S / WATCH_FRAMES)
                forces = np.linalg.norm(cell.contact_forces(times), axis=1)
                self.truths.append((now, float(forces.max())))
                self.goals.append((now, cell.robot.motion.goal(now)[0][2]))
                clock.call_at(now + WATCH_S, look)

            look()
            return cell

        output, errors = io.StringIO(), io.StringIO()
        with (
            mock.patch("hil_bridge.runs.compose.make_cell", watched),
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(errors),
        ):
            try:
                code = execute(self.config, True, Outputs(path), False)
            except BridgeError as error:
                code = error.exit_code
                errors.write(str(error))
        self.said = output.getvalue() + errors.getvalue()
        try:
            return code, read(path)
        except BridgeError:
            return code, None


def broken(drawn: Drawn, code: int, recording: Recording | None) -> Iterator[str]:
    """Every promise that a run did not keep, in words."""
    if "Traceback" in drawn.said or "bug" in drawn.said:
        yield f"a bug: {drawn.said}"
    if (took := drawn.truths[-1][0] - drawn.began) > LONGEST_S:
        yield f"took {took:.0f} s"
    trusted = drawn.kind not in LYING or drawn.phase in BEFORE
    largest = max(force for _, force in drawn.truths)
    if trusted and drawn.kind not in MOVES_ITSELF and largest > drawn.bound:
        yield f"pressed with {largest:.0f} N of {drawn.bound:.0f} N"
    if code == 0 and drawn.truths[-1][1] > 1.0:
        yield f"completed while pressing with {drawn.truths[-1][1]:.1f} N"
    assert drawn.cell is not None
    struck = any(injection.struck for injection in drawn.cell.faults)
    if drawn.kind in SEEN_BY_WEIGHT and drawn.phase == "connect" and struck and recording is not None:
        yield "moved although the weight was wrong"
    if code == 3:
        cause = drawn.said.rpartition("stopped: ")[2] if "stopped: " in drawn.said else drawn.said
        if not struck and not drawn.hits(cause):
            yield f"stopped without a fault that struck: {cause}"
        elif not re.search(FITTING[drawn.target], cause) and not drawn.hits(cause):
            yield f"the cause does not fit: {cause}"
    if code not in (0, 3):
        yield f"ended with {code}: {drawn.said}"
    if recording is None:
        return
    if recording.truncated or not recording.end:
        yield "the recording is not whole"
    if any(cycle.differences for cycle in replay(recording, drawn.config, forced=False)):
        yield "the replay differs"
    stops = [event.at for event in recording.events if event.kind == "stop"]
    if stops:
        # one order may have been on the line when the stop came
        after = [height for at, height in drawn.goals if at > stops[0] + 0.4]
        if any(later < earlier - 1e-6 for earlier, later in itertools.pairwise(after)):
            yield "an order went deeper after the stop"


@pytest.fixture(scope="module")
def exercised() -> dict[str, Counter[tuple[str, str]]]:
    """How often each fault was injected, and had an effect."""
    counts: dict[str, Counter[tuple[str, str]]] = {"injected": Counter(), "struck": Counter()}
    return counts


@pytest.mark.parametrize("block", range(math.ceil(SEEDS / BLOCK)))
@pytest.mark.timeout(600)
def test_the_guard_keeps_its_promises(
    block: int, tmp_path: Path, exercised: dict[str, Counter[tuple[str, str]]]
) -> None:
    troubles = []
    for seed in range(block * BLOCK, min((block + 1) * BLOCK, SEEDS)):
        drawn = Drawn.of(seed)
        path = tmp_path / f"{seed}.mcap"
        code, recording = drawn(path)
        assert drawn.cell is not None
        for injection in drawn.cell.faults:
            exercised["injected"][drawn.kind] += 1
            exercised["struck"][drawn.kind] += injection.struck > 0
        name = f"seed {seed}: {drawn.target} {drawn.fault} in {drawn.phase}"
        troubles += [f"{name}: {trouble}" for trouble in broken(drawn, code, recording)]
        path.unlink()
    assert troubles == []


def test_every_fault_was_exercised(exercised: dict[str, Counter[tuple[str, str]]]) -> None:
    """Runs after all blocks."""
    kinds = [(target, name) for target, faults in CELL_FAULTS.items() for name in faults]
    print()
    for kind in kinds:
        print(f"{kind[0]:<10}{kind[1]:<20}{exercised['injected'][kind]:>6}{exercised['struck'][kind]:>6}")
    assert [kind for kind in kinds if not exercised["struck"][kind]] == []
