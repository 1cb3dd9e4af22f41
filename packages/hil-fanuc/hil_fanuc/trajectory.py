"""Trajectories of positions for the emulated controller, over its three channels, with the client of a run."""

from collections.abc import Iterator
from typing import Any

from hil_bridge.devices.trajectory import Trajectory, TrajectoryResult, stream_trajectory
from hil_fanuc.channels import Channel, OpenSession, Piece, Pieces
from hil_fanuc.client import FanucClient
from hil_fanuc.controller import FanucController
from hil_fanuc.rmi_server import Connection, Door
from protocol.datagram import Datagram

_SIDE = "client"


def play(robot: Any, trajectory: Trajectory, settings: Any, now: float) -> TrajectoryResult:
    """Run a trajectory; see `hil_bridge.devices.trajectory.PlayTrajectory`."""
    client = FanucClient(settings.client, now)
    return stream_trajectory(_Controller(robot, client), client, trajectory, now)


class _Controller:
    """Endpoint of pieces for a controller. It reports deadlines of the client too, as their only clock."""

    def __init__(self, robot: FanucController, client: FanucClient) -> None:
        self._robot, self._client = robot, client
        self._lines: dict[Channel, Door | Connection] = {Channel.DOOR: Door(robot.interface)}

    def _ends(self) -> Iterator[Any]:
        yield from (self._client, self._robot.endpoint, *self._lines.values())

    def receive(self, data: Pieces, now: float) -> None:
        for piece in data:
            if isinstance(piece, OpenSession):
                self._lines[Channel.SESSION] = Connection(self._robot.interface, now)
            elif isinstance(piece, Piece) and piece.channel is Channel.STREAM:
                self._robot.endpoint.receive([Datagram(piece.data, now, _SIDE)], now)
            elif isinstance(piece, Piece):
                self._lines[piece.channel].receive(piece.data, now)

    def data_to_send(self, now: float) -> Pieces:
        stream = [Piece(Channel.STREAM, datagram) for datagram in self._robot.endpoint.data_to_send(now)]
        lines = [Piece(channel, line.data_to_send(now)) for channel, line in self._lines.items()]
        return stream + [piece for piece in lines if piece.data]

    def next_deadline(self) -> float | None:
        return min((at for end in self._ends() if (at := end.next_deadline()) is not None), default=None)

    def handle_deadline(self, now: float) -> None:
        for end in self._ends():
            at = end.next_deadline()
            if at is not None and at <= now:
                end.handle_deadline(now)
