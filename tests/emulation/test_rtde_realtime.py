"""Tests of the real-time interface of an emulated controller: its rate, its values, its clients, and text."""

from itertools import pairwise
from typing import Any

import pytest

from emulators.devices.rtde import RTDE_FAULTS, RtdeProfile, RtdeRobot, Server
from emulators.devices.rtde.state import getter
from emulators.faults import Ledger
from emulators.seams import StartPose
from protocol.devices.rtde import realtime
from protocol.devices.rtde.states import Runtime
from protocol.devices.rtde.wires import Port

START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
T0 = 1000.25


class Client:
    """Connection to the interface, driven by its deadlines."""

    def __init__(self, robot: RtdeRobot, now: float = T0, port: Port = Port.REALTIME) -> None:
        server = robot.connect(port, now)
        assert server is not None
        self.server: Server = server
        self.now = now
        self.states: list[dict[str, float]] = []
        self.sizes: list[int] = []

    def wait(self, seconds: float) -> "Client":
        end = self.now + seconds
        while (due := self.server.next_deadline()) is not None and due <= end:
            self.now = max(self.now, due)
            self.server.handle_deadline(self.now)
            if packet := self.server.data_to_send(self.now):
                self.sizes.append(len(packet))
                self.states.append(realtime.decode(packet))
        self.now = end
        return self


def robot(**profile: Any) -> RtdeRobot:
    return RtdeRobot(RtdeProfile(**profile), START, T0, 7)


@pytest.mark.parametrize(
    ("settings", "rate_hz", "size"),
    [
        ({}, 500, 1220),
        ({"version": "5.9.4.0"}, 500, 1140),
        ({"version": "5.1.0.0"}, 500, 1108),
        ({"version": "3.15.8.0", "cycle_ms": 8.0, "model": "ur10"}, 125, 1140),
        ({"version": "3.5.0.0", "cycle_ms": 8.0, "model": "ur10"}, 125, 1108),
    ],
)
def test_state_of_each_cycle_has_length_of_version(settings: dict[str, Any], rate_hz: int, size: int) -> None:
    client = Client(robot(**settings)).wait(0.5005)
    assert len(client.states) == pytest.approx(rate_hz / 2, abs=1)
    assert set(client.sizes) == {size}
    times = [state["timestamp"] for state in client.states]
    steps = [after - before for before, after in pairwise(times)]
    assert steps[1:] == pytest.approx([1.0 / rate_hz] * (len(steps) - 1))


def test_values_match_rtde() -> None:
    ur = robot(version="5.12.0.0")
    ur.controller.io.slider = 0.4
    ur.controller.force.payload = (1.5, 0.0, 0.01, 0.05)
    ur.controller.io.write_output("actual_digital_output_bits", 5)
    client = Client(ur).wait(0.01)
    displayed = ur.controller.snapshots[0]
    for name in (name for name in realtime.layout_of(ur.controller.version).outputs if name):
        values = getter(name)(displayed)
        names = [name] if len(values) == 1 else [f"{name}_{at}" for at in range(len(values))]
        assert [client.states[-1][each] for each in names] == pytest.approx(values), name
    state = client.states[-1]
    assert (state["robot_mode"], state["speed_scaling"], state["payload"]) == (7, 0.4, 1.5)
    assert (state["actual_digital_output_bits"], state["actual_TCP_pose_2"]) == (
        5,
        pytest.approx(0.6, abs=1e-4),
    )


def test_all_clients_receive_same_state() -> None:
    ur = robot()
    first, second = Client(ur), Client(ur, port=Port.REALTIME_READ_ONLY)
    for seconds in (0.001, *[0.002] * 20):
        first.wait(seconds)
        second.wait(seconds)
    assert first.states == second.states
    assert len(first.states) == 20


def test_text_is_program_unless_read_only() -> None:
    ur = robot()
    Client(ur, port=Port.REALTIME_READ_ONLY).server.receive(b"sleep(5)\n", T0)
    client = Client(ur)
    client.wait(0.2)
    assert (ur.controller.player.runtime, client.states[-1]["runtime_state"]) == (Runtime.STOPPED, 1)
    assert ur.controller.counts["text to a read-only interface"] == 1
    client.server.receive(b"sleep(5)\n", client.now)
    client.wait(0.1)
    assert client.states[-1]["runtime_state"] == Runtime.PLAYING


def test_slow_client_resumes_with_newest_state() -> None:
    ur = robot()
    client = Client(ur).wait(0.01)
    full = [True]
    client.server.spare(lambda: full[0])
    count = len(client.states)
    client.wait(0.5)
    assert len(client.states) == count
    assert ur.controller.counts["real-time states left out"] == pytest.approx(250, abs=1)
    full[0] = False
    client.wait(0.002)
    assert len(client.states) == count + 1
    assert client.states[-1]["timestamp"] == ur.controller.snapshots[0].time


def test_late_process_sends_newest_state_only() -> None:
    client = Client(robot()).wait(0.01)
    count = len(client.states)
    client.now += 1.0
    client.server.handle_deadline(client.now)
    assert len(realtime.decode(client.server.data_to_send(client.now))) > 0
    client.wait(0.002)
    assert len(client.states) == count + 1


def test_pose_faults_apply_to_realtime_interface() -> None:
    ur = robot(joint_noise_urad=0.0, joint_bits=0)
    ledger = Ledger(RTDE_FAULTS)
    for target, handlers in ur.handlers.items():
        ledger.attach(target, handlers)
    client = Client(ur).wait(0.01)
    ledger.inject("pose", "offset", client.now, {"z_mm": 5.0})
    before = client.states[-1]
    client.wait(0.01)
    changes = [
        client.states[-1][f"actual_TCP_pose_{at}"] - before[f"actual_TCP_pose_{at}"] for at in range(3)
    ]
    assert changes == pytest.approx([0.0, 0.0, 0.005], abs=1e-6)
