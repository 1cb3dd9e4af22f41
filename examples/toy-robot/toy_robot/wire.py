"""The arm on the wire: datagrams of UDP, packed little-endian, and the client that the bridge drives.

| datagram | way | content |
|---|---|---|
| `AH` | to the arm | hello: send reports to this address, every 4 ms |
| `AR` | from the arm | number, position in m, quaternion w x y z, 1 for a stopped arm |
| `AT` | to the arm | number of the report that it answers, the next set point as in a report |
"""

import struct
from collections import deque
from collections.abc import Sequence

from protocol.datagram import arrived_at
from protocol.geometry import Pose
from protocol.robot import ReportReceived, RobotReport, StreamEvent, pose_fault

REPORT, TARGET = struct.Struct("<2sI3d4dB"), struct.Struct("<2sI3d4d")
HELLO = b"AH"
CYCLE_S = 0.004
HELLO_AGAIN_S = 0.25
"""Time without reports after which the client says hello again, s. If none come at all, the link reports it."""


class ArmClient:
    """Client of the arm: it answers each report."""

    def __init__(self, now: float) -> None:
        self._events: deque[StreamEvent] = deque()
        self._out: list[bytes] = []
        self._hello_at: float | None = now
        self._newest = 0

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            if len(datagram) != REPORT.size or not datagram.startswith(b"AR"):
                continue
            _, number, x, y, z, *quaternion, stopped = REPORT.unpack(datagram)
            w, i, j, k = quaternion
            pose, at = Pose((x, y, z), (w, i, j, k)), arrived_at(datagram, now)
            wrong = pose_fault(pose)
            fault = f"it reports {wrong}" if wrong else "it is stopped; release it" if stopped else ""
            self._newest, self._hello_at = number, None
            self._events.append(ReportReceived(RobotReport(number, pose, at, at, fault)))

    def next_event(self) -> StreamEvent | None:
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return self._hello_at

    def handle_deadline(self, now: float) -> None:
        if self._hello_at is not None and now >= self._hello_at:
            self._out.append(HELLO)
            self._hello_at = now + HELLO_AGAIN_S

    def begin(self, pose: Pose) -> None:
        """Do nothing: the arm needs no start."""

    def target(self, pose: Pose, now: float) -> None:
        self._out.append(TARGET.pack(b"AT", self._newest, *pose.position, *pose.quaternion))

    def hold(self, now: float) -> None:
        """Do nothing: an arm without an answer stays where it is."""

    def end(self) -> None:
        """Do nothing: the arm needs no end."""
