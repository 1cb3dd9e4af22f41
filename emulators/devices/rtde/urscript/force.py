"""Functions on the force on the tool: measurement, force mode, freedrive and contact.

Source of all meanings and ranges: Universal Robots' script manual.
"""

import math
from typing import Any

from emulators.devices.rtde.urscript.failures import ScriptError
from emulators.devices.rtde.urscript.host import Host
from emulators.devices.rtde.urscript.motion import finite_six, read_output
from emulators.devices.rtde.urscript.poses import pose
from emulators.devices.rtde.urscript.table import Function, modelled, tagged
from emulators.devices.rtde.urscript.values import Value, integer, number, truth, vector
from protocol.geometry import Pose

_BASE = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


def _enable_force(task: Any, enable: Value, *rest: Value) -> None:
    task.host.enable_external_force(truth(enable))


def _axes(value: Value) -> tuple[bool, ...]:
    return tuple(part != 0.0 for part in vector(value, 6))


def _force_mode(task: Any, frame: Value, selection: Value, *rest: Value) -> None:
    """Start force mode. `rest` are wrench, type and limits."""
    wrench, kind, limits = finite_six(rest[0]), integer(rest[1]), finite_six(rest[2])
    if kind not in (1, 2, 3):
        raise ScriptError(f"the type of force mode must be 1, 2 or 3, got {kind}")
    host: Host = task.host
    host.force_mode(pose(frame), _axes(selection), wrench, kind, limits)


def _range(value: Value, name: str, highest: float) -> float:
    limit = number(value)
    if not 0.0 <= limit <= highest:
        raise ScriptError(f"{name} of force mode must be from 0 to {highest:g}")
    return limit


def _freedrive(task: Any, axes: Value, feature: Value) -> None:
    """Start freedrive. `feature` is a pose. If it is missing or a name, the base frame is used (assumed)."""
    frame = _BASE if feature is None or isinstance(feature, str) else pose(feature)
    task.host.freedrive(frame, _axes(axes))


def _teach(task: Any) -> None:
    task.host.freedrive(_BASE, (True,) * 6)


def _contact(task: Any, direction: Value, threshold: Value) -> Value:
    """Return whether the tool is in contact. A threshold of 0 selects the controller's own threshold."""
    x, y, z, *_ = finite_six(direction)
    least = number(threshold)
    if not (math.isfinite(least) and least >= 0.0):
        raise ScriptError("a force threshold must be at least 0")
    host: Host = task.host
    return host.steps_since_contact((x, y, z), least)


def _history(task: Any, steps: Value) -> Value:
    count = integer(steps)
    if count < 0:
        raise ScriptError("the number of history steps must be at least 0")
    return tuple(task.host.joints_before(count))


FORCE: tuple[Function, ...] = (
    modelled("get_tcp_force()", read_output("actual_TCP_force")),
    modelled("force()", lambda task: math.hypot(*task.host.output("actual_TCP_force")[:3])),
    modelled("zero_ftsensor()", lambda task: task.host.zero_force()),
    modelled(
        "ft_rtde_input_enable(enable, sensor_mass=0, sensor_measuring_offset=None, sensor_cog=None)",
        _enable_force,
    ),
    modelled(
        "enable_external_ft_sensor(enable, sensor_mass=0, sensor_measuring_offset=None, sensor_cog=None)",
        _enable_force,
    ),
    modelled("force_mode(task_frame, selection_vector, wrench, type, limits)", _force_mode),
    modelled("end_force_mode()", lambda task: task.host.end_force_mode(False)),
    modelled(
        "force_mode_set_damping(damping)",
        lambda task, damping: task.host.set_damping(_range(damping, "the damping", 1.0)),
    ),
    modelled(
        "force_mode_set_gain_scaling(scaling)",
        lambda task, scaling: task.host.set_gain_scaling(_range(scaling, "the gain scaling", 2.0)),
    ),
    modelled("force_mode_get_damping()", lambda task: task.host.damping),
    modelled("force_mode_get_gain_scaling()", lambda task: task.host.gain_scaling),
    modelled("freedrive_mode(freeAxes=[1, 1, 1, 1, 1, 1], feature=None)", _freedrive),
    tagged("freedrive_mode_no_incorrect_payload_check()"),
    modelled("end_freedrive_mode()", lambda task: task.host.end_force_mode(True)),
    tagged("get_freedrive_status()", 0),
    modelled("teach_mode()", _teach),
    modelled("end_teach_mode()", lambda task: task.host.end_force_mode(True)),
    modelled("tool_contact(direction=[0, 0, 0, 0, 0, 0], force_threshold=0)", _contact),
    modelled("get_actual_joint_positions_history(steps=0)", _history),
)
