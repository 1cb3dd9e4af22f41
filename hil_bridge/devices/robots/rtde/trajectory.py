"""Trajectories for the emulated Universal Robots controller. A program on the controller reads the orders from
registers.

In every cycle, the program passes joint positions to `servoj`, joint speeds to `speedj`, and Cartesian positions to
`servoj` through the inverse kinematics.
"""

from collections.abc import Sequence
from typing import Any

from hil_bridge.devices.trajectory import FAMILIES, Trajectory, TrajectoryResult
from hil_bridge.errors import ConfigError
from protocol.devices.rtde import packets
from protocol.devices.rtde.fields import Recipe
from protocol.devices.rtde.packets import Kind, Reader
from protocol.devices.rtde.states import Runtime, SafetyMode
from protocol.devices.rtde.wires import Port

_REGISTERS = tuple(f"input_double_register_{k}" for k in range(6))
_READY = "output_int_register_0"
_PARTS = {
    "target_q": "target_q",
    "target_qd": "target_qd",
    "target_position": "target_TCP_pose",
    "q": "actual_q",
    "qd": "actual_qd",
    "position": "actual_TCP_pose",
}
"""Output variable of each family. Of a pose, only the first three values are used."""
_OUTPUTS = ("timestamp", _READY, "runtime_state", "safety_mode", "actual_TCP_force", *_PARTS.values())
_READING = ", ".join(f"read_input_float_register({k})" for k in range(6))
_BEGIN_S = 60.0
"""Time-out for the arm to reach the start of the trajectory, s. Chosen."""
_SPEED_ACCELERATION = 40.0
"""Acceleration limit of `speedj`, rad/s². Chosen: more than a trajectory needs, so that the arm has the speeds of
the trajectory.
"""
_MOVE_SPEED, _MOVE_ACCELERATION = 1.0, 1.4
"""Speed and acceleration of `movej`, rad/s and rad/s². Standard: defaults of the script manual."""


def play(robot: Any, trajectory: Trajectory, settings: Any, now: float) -> TrajectoryResult:
    """Run a trajectory; see `hil_bridge.devices.trajectory.PlayTrajectory`."""
    return _Player(robot, trajectory, settings, now).run()


class _Player:
    """Trajectory in progress, run by an RTDE client in virtual time."""

    def __init__(self, robot: Any, trajectory: Trajectory, settings: Any, now: float) -> None:
        self._trajectory, self._now = trajectory, now
        self._zero = trajectory.values[0] if trajectory.family == "order_position" else (0.0,) * 6
        """Offset that is subtracted from each order, so that a trajectory of positions begins at the present
        position of the arm.
        """
        self._powered, self._uptime = now, settings.emulated.uptime_s
        self._cycle = settings.emulated.cycle_ms * 1e-3
        self._server = robot.connect(Port.RTDE, now)
        self._reader = Reader()
        self._ask(packets.version_request(packets.PROTOCOL_VERSION))
        types = packets.read_types(self._ask(packets.inputs_request(_REGISTERS)))
        self._inputs = Recipe(types.recipe, _REGISTERS, types.types)
        rate = min(1.0 / trajectory.period, 1.0 / self._cycle)
        types = packets.read_types(self._ask(packets.outputs_request(_OUTPUTS, rate)))
        self._outputs = Recipe(types.recipe, _OUTPUTS, types.types)
        self._ask(packets.encode(Kind.START))
        self._rows: list[dict[str, Any]] = []
        script = robot.connect(Port.SCRIPT, now)
        script.receive(_program(trajectory, settings.client).encode(), now)

    def run(self) -> TrajectoryResult:
        """Run the trajectory and return the reports. Raises ConfigError if the robot stops."""
        while not self._rows or not self._rows[-1][_READY]:
            if self._now - self._powered > _BEGIN_S:
                raise ConfigError("the emulated arm has not reached the start of the trajectory")
            self._run_cycle(self._trajectory.values[0])
        began = self._now
        home = self._rows[-1][_PARTS["target_position"]]
        self._rows.clear()
        times, orders = [], []
        end = self._trajectory.end + 2.0 * self._trajectory.period
        while self._now - began <= end:
            before, order = len(self._rows), self._trajectory.at(self._now - began)
            self._run_cycle(order)
            if len(self._rows) > before:
                row = self._rows[-1]
                self._check(row)
                stamp = row["timestamp"] - self._uptime + self._powered
                times.append((self._now if self._trajectory.at_arrival else stamp) - began)
                orders.append(self._trajectory.at(times[-1]))
        return TrajectoryResult(times, self._columns(orders, home))

    def _columns(self, orders: Sequence[tuple[float, ...]], home: Sequence[float]) -> dict[str, list[float]]:
        """Return all columns. `home` is the start position of the arm. In a trajectory of positions, positions are
        relative to the first order.
        """
        columns = {}
        places = self._trajectory.family == "order_position"
        for family, output in _PARTS.items():
            for k, name in enumerate(FAMILIES[family]):
                offset = self._zero[k] - home[k] if places and family.endswith("position") else 0.0
                columns[name] = [row[output][k] + offset for row in self._rows]
        for k, name in enumerate((*FAMILIES["force"], *FAMILIES["moment"])):
            columns[name] = [row["actual_TCP_force"][k] for row in self._rows]
        for k, name in enumerate(FAMILIES[self._trajectory.family]):
            columns[name] = [order[k] for order in orders]
        return columns

    def _check(self, row: dict[str, Any]) -> None:
        if row["safety_mode"] not in (SafetyMode.NORMAL, SafetyMode.REDUCED):
            raise ConfigError(
                f"the emulated robot has stopped: {SafetyMode(row['safety_mode']).name.lower()}"
            )
        if row["runtime_state"] != Runtime.PLAYING:
            raise ConfigError("the program on the emulated robot has ended before the trajectory")

    def _run_cycle(self, order: tuple[float, ...]) -> None:
        """Write the order, advance the controller by one cycle, and read the data of that cycle."""
        values = [part - zero for part, zero in zip(order, self._zero, strict=False)]
        values += [0.0] * (len(_REGISTERS) - len(values))
        self._server.receive(self._inputs.pack(*values), self._now)
        self._now += self._cycle
        self._server.handle_deadline(self._now)
        self._reader.feed(self._server.data_to_send(self._now))
        while (packet := self._reader.next_packet()) is not None:
            if packet.kind == Kind.DATA:
                self._rows.append(self._outputs.values(self._outputs.unpack(packet.payload)))

    def _ask(self, question: bytes) -> bytes:
        """Send a request and return the payload of the answer."""
        self._server.receive(question, self._now)
        self._reader.feed(self._server.data_to_send(self._now))
        packet = self._reader.next_packet()
        assert packet is not None, "a controller without faults answers"
        return packet.payload


def _program(trajectory: Trajectory, client: Any) -> str:
    """Return the robot program for a family of orders."""
    servo = f"t=get_steptime(), lookahead_time={client.lookahead_s:g}, gain={client.gain:g}"
    start = trajectory.values[0] if trajectory.family == "order_q" else trajectory.start
    begin = "sync()"
    if start:
        begin = f"movej([{', '.join(map(repr, start))}], a={_MOVE_ACCELERATION}, v={_MOVE_SPEED})"
    match trajectory.family:
        case "order_q":
            order = f"servoj([{_READING}], {servo})"
        case "order_qd":
            order = f"speedj([{_READING}], a={_SPEED_ACCELERATION}, t=get_steptime())"
        case _:  # places
            place = ", ".join(f"home[{k}] + read_input_float_register({k})" for k in range(3))
            order = f"servoj(get_inverse_kin(p[{place}, home[3], home[4], home[5]]), {servo})"
    return f"""\
def play_course():
  {begin}
  home = get_target_tcp_pose()
  write_output_integer_register(0, 1)
  while True:
    {order}
  end
end
"""
