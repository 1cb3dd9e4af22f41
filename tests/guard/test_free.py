"""Freeing a tool that a dead run left in contact, in virtual time."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.facts import Devices, RobotFacts
from hil_bridge.errors import ConfigError, DeviceError, SafetyStop
from hil_bridge.record import Recording
from hil_bridge.runs.compose import open_devices
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config
from hil_bridge.site.free import Freeing, FreeResult
from hil_bridge.site.return_path import start_of
from protocol.geometry import Vector
from tests.paper_cell import PaperCell

pytestmark = pytest.mark.sweep

Configured = Callable[..., Config]


def left_with(stiffness: float, force: float, **more: Any) -> dict[str, Any]:
    """A cell whose tool presses with this force. The arm is rigid."""
    start = (900.0, -100.0, 590.0 - force / stiffness * 1e3)
    return {"cell": {"start_position_mm": start, "arm": {"compliance": "rigid"}, **more}}


def freed(
    config: Config, distance_mm: float, prepare: Callable[[PaperCell], object] = lambda cell: None
) -> tuple[FreeResult, float]:
    """Result, and the true contact force at the end, N."""
    forces: list[float] = []
    lines: list[str] = []

    async def main() -> FreeResult:
        clock = Clock.running()

        async with open_devices(Setup(config), clock, CallbackLog()) as devices:
            cell = devices.cell
            assert cell is not None
            prepare(cell)
            result = await Freeing(config, clock, devices.robot, devices.sensor, lines.append)(distance_mm)
            forces.append(math.hypot(*cell.true_state(clock.now()).contact_force))
            return result

    result = run_virtual(main)
    assert lines[-1].startswith(f"moved {distance_mm:.3f} mm, force ")
    return result, forces[0]


@pytest.mark.parametrize("unchecked", [False, True])
@pytest.mark.parametrize("stiffness", [5e3, 5e4])
def test_free_lifts_pressing_tool(configured: Configured, stiffness: float, unchecked: bool) -> None:
    config = configured(stiffness, left_with(stiffness, 80.0), {"sensor": {"unchecked": unchecked}})
    distance = 80.0 / stiffness * 1e3 + 2.0
    result, force = freed(config, distance)
    assert result.moved_mm == pytest.approx(distance)
    assert result.known is not unchecked
    if not unchecked:
        assert result.text == f"freed by {distance:.1f} mm: contact force 80.0 N before, 0.0 N after"
    assert force == 0.0


@pytest.mark.parametrize("stiffness", [5e3, 5e4])
def test_free_in_wrong_direction_stops(configured: Configured, stiffness: float) -> None:
    config = configured(stiffness, left_with(stiffness, 20.0), {"frame": {"approach": (0.0, 0.0, 1.0)}})
    with pytest.raises(
        SafetyStop, match=r"the force rose to .* N while the tool moved .* mm away: the tool has stopped"
    ):
        freed(config, 5.0)


def test_free_below_obstacle_stops(configured: Configured) -> None:
    config = configured(5e3, {"cell": {"obstacle": {"height_mm": 2.0, "stiffness_n_m": 5e4}}})
    with pytest.raises(SafetyStop, match="the force rose"):
        freed(config, 10.0)


def test_free_below_soft_obstacle_stops(configured: Configured) -> None:
    """An obstacle of 0.8 kN/m adds at most 0.4 N a step, which is allowed, and 7 N over the entire path."""
    obstacle = {"obstacle": {"height_mm": 1.0, "stiffness_n_m": 800.0}}
    with pytest.raises(SafetyStop, match=r"the force rose to [01]\.\d N"):
        freed(configured(5e3, {"cell": obstacle}), 10.0)


def test_free_in_emergency_stop_does_not_move(configured: Configured) -> None:
    with pytest.raises(DeviceError, match="emergency stop"):
        freed(configured(5e3), 5.0, lambda cell: cell.robot.press_emergency_stop(0.0))


# --- back to a recorded start

ABOVE = {"cell": {"start_position_mm": (900.0, -92.0, 608.0)}}
"""Tool that a successful run left 18 mm above the surface, 8 mm along its path."""
START_M = (0.9, -0.1, 0.6)


def return_to(
    config: Config, goal: Vector = START_M, dead: str = "", distance_mm: float = 20.0
) -> tuple[FreeResult, Vector]:
    """Return the result and the true final position of the tool, m; `dead` names a dead force axis."""

    async def main() -> tuple[FreeResult, Vector]:
        clock = Clock.running()
        async with open_devices(Setup(config), clock, CallbackLog()) as devices:
            assert devices.cell is not None
            if dead:
                devices.cell.inject("signal", "dead", clock.now(), axis=dead)
            result = await Freeing(config, clock, devices.robot, devices.sensor, lambda text: None)(
                distance_mm, goal
            )
            return result, devices.cell.true_state(clock.now()).position

    return run_virtual(main)


@pytest.mark.parametrize("robot", ["s3", "egm", "rtde", "rsi"])
def test_free_back_to_start_ends_there(configured: Configured, robot: str) -> None:
    result, position = return_to(configured(5e3, ABOVE, {"robot": {"emulated": robot}}))
    assert position == pytest.approx(START_M, abs=0.4e-3)  # the arm sags under the tool, a UR most
    assert result.back_mm == pytest.approx(8.0 + 9.0, abs=0.2)
    assert result.text.endswith(" mm back to the start")


@pytest.mark.parametrize(("stiffness", "most_n"), [(5e3, 3.6), (5e4, 11.0)])
def test_free_back_to_start_stops_at_touch(configured: Configured, stiffness: float, most_n: float) -> None:
    """The work piece is 8 mm thicker than in the run that is gone back to: 2 mm above its start."""
    thick = {"cell": {"surface": {"height_mm": 602.0}}, "task": {"expected_stiffness_n_m": stiffness}}
    with pytest.raises(SafetyStop, match=r"N on the tool after .* mm of the path back") as stopped:
        return_to(configured(stiffness, ABOVE, thick))
    assert 1.0 < float(str(stopped.value).split()[0]) < most_n


@pytest.mark.parametrize("axis", ["fx", "fy"])
def test_free_back_to_start_stops_at_wall_on_dead_axis(configured: Configured, axis: str) -> None:
    """No weight lies on either axis; the moments show what the dead one does not."""
    cell = {"start_position_mm": (900.0, -100.0, 608.0), "surface": {"wall_at_mm": -96.0}}
    with pytest.raises(SafetyStop, match=r"N on the tool after [34]\.\d* mm of the path back"):
        return_to(configured(5e3, {"cell": cell}), (0.9, -0.09, 0.6), axis)


def test_free_back_to_start_stops_for_stuck_sensor(configured: Configured) -> None:
    """The sensor sticks once the tool is on its path back, where no force would rise any more."""

    async def main() -> None:
        clock = Clock.running()
        async with open_devices(Setup(configured(5e3, ABOVE)), clock, CallbackLog()) as devices:
            cell = devices.cell
            assert cell is not None

            def report(text: str) -> None:
                if text.startswith("0.000 mm of the path back"):
                    cell.inject("signal", "stuck", clock.now())

            config = configured(5e3, ABOVE)
            await Freeing(config, clock, devices.robot, devices.sensor, report)(1.0, START_M)

    with pytest.raises(SafetyStop, match="stuck, dead or saturated"):
        run_virtual(main)


def test_free_back_to_start_refuses_sensor_that_lost_its_weight(configured: Configured) -> None:
    with pytest.raises(DeviceError, match="Fz is dead"):
        return_to(configured(5e3, ABOVE), dead="fz", distance_mm=1.0)


def test_free_back_to_start_crosses_above_it(configured: Configured) -> None:
    """A tool that a stop left pressing is first lifted to the height of the start."""
    result, position = return_to(configured(5e3, left_with(5e3, 20.0)))
    assert result.moved_mm == pytest.approx(20.0, abs=0.2)
    assert position == pytest.approx(START_M, abs=0.2e-3)


def test_free_back_to_start_needs_tool_and_workspace(configured: Configured) -> None:
    with pytest.raises(ConfigError, match="needs the mass of the tool"):
        return_to(configured(5e3, ABOVE, {"sensor": {"unchecked": True}}))
    box = {"limits": {"workspace_max_m": (3.0, 3.0, 0.599)}}
    with pytest.raises(ConfigError, match=r"the recorded start, 900\.0 -100\.0 600\.0 mm, is outside limits"):
        return_to(configured(5e3, ABOVE, box))


@pytest.mark.parametrize(
    ("robot", "message"),
    [
        (
            RobotFacts(kind="rtde", emulated=True),
            "of an emulated robot, whose start is not a position in this cell",
        ),
        (RobotFacts(kind="egm"), "of a robot of kind egm, and this one is of kind rtde"),
        (RobotFacts(kind="rtde"), "no cycle"),
        (RobotFacts(), "no cycle"),
    ],
)
def test_free_back_to_refuses_start_of_another_robot(robot: RobotFacts, message: str) -> None:
    recording = Recording((), (), (), {}, devices=Devices(robot=robot).as_metadata())
    with pytest.raises(ConfigError, match=message):
        start_of(recording, "rtde")
