"""State of the Remote Motion Interface of the emulated controller, for all connections."""

import math
from typing import Protocol

from emulators.orders import ReceivedOrder
from hil_fanuc import rmi
from hil_fanuc.motion import Motion
from hil_fanuc.profile import FanucProfile
from hil_fanuc.program import Program
from hil_fanuc.rmi import Message
from hil_fanuc.rmi_motions import RmiMotions
from hil_fanuc.stream_server import StreamServer


class Host(Protocol):
    """Part of a controller that its Remote Motion Interface uses."""

    profile: FanucProfile
    program: Program
    motion: Motion
    server: StreamServer
    rmi_motions: RmiMotions

    def abort(self) -> None:
        """Abort the TP programs."""

    def report_order(self, order: ReceivedOrder) -> None:
        """Report an order to the judge."""

    def reset(self, now: float) -> bool:
        """Clear alarms whose cause is gone; return whether none is left."""

    def is_silent(self, now: float) -> bool:
        """Return whether a fault keeps the interface from answering."""


class Session(Protocol):
    """Connection of the client that is served."""

    def push(self, message: Message) -> None:
        """Send a line that answers no request."""


class Interface:
    """State of the interface, for all connections."""

    def __init__(self, host: Host) -> None:
        self.host = host
        self.port = rmi.SESSION_PORT
        """Port of the session that the door names."""
        self.owner: Session | None = None
        self._free_at = -math.inf
        self.initialized = False
        self.sequence = 1
        """Next sequence number of an instruction."""
        self.override = 100
        self.frames: dict[str, Message] = {}
        self.numbers = {"UFrameNumber": 0, "UToolNumber": 1}
        self.registers: dict[int, float] = {}
        self.positions: dict[int, Message] = {}
        """Position registers."""
        self.ports: dict[tuple[str, int], float] = {}
        """Values of written outputs, by type and number."""

    def claim(self, connection: Session, now: float) -> bool:
        """Return whether a connection is, or becomes, the session."""
        if self.owner is None and now >= self._free_at - 1e-9:
            self.owner = connection
        return self.owner is connection

    def free(self, connection: Session, now: float, by_request: bool) -> None:
        """End the session of a connection."""
        if self.owner is not connection:
            return
        profile = self.host.profile
        self.host.rmi_motions.clear()
        self.owner, self.initialized = None, False
        self._free_at = now + (profile.rmi_free_s if by_request else profile.rmi_lost_s)
        if by_request:
            self.sequence = 1
        elif profile.lost_client == "abort":
            self.host.abort()

    def push_done(self, answers: list[Message]) -> None:
        """Send the answers to instructions that have ended, and empty their list."""
        for answer in answers:
            if self.owner is not None:
                self.owner.push(answer)
        answers.clear()

    def push_fault(self) -> None:
        """Report an alarm to the client."""
        if self.owner is not None:
            self.owner.push({"Communication": "FRC_SystemFault", "SequenceID": self.sequence})
