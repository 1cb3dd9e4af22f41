"""Transcripts of third-party clients with our emulated devices: their format, and the device that replays them.

`python -m tools.record_clients` rewrites the files in tests/wire/transcripts/clients; tests replay them. The
device's clock advances only with the steps, so it sends exactly the same bytes again. A file begins with `key:
value` lines. Every other line is a step: time, ms, side, wire, and data. `opens` and `closes` denote a connection.
Data of printable characters is a JSON string; other data is hexadecimal. The last lines are `reads` and `sends`, in
JSON: the values that the client read, and the values that its program ordered it to send.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from emulators.devices.ati_can import AtiCanBoard, AtiCanProfile
from emulators.devices.egm import EgmController, EgmProfile
from emulators.devices.ft300 import Ft300, Ft300Profile
from emulators.devices.netft import NetBox, NetFtProfile
from emulators.devices.netft.page import PageEndpoint
from emulators.devices.rsi import RsiController, RsiProfile
from emulators.devices.rtde import ProgramSocket, RtdeProfile, RtdeRobot
from emulators.seams import Floats, StartPose
from emulators.sensing import KnownWrench
from protocol.can.frame import CanFrame
from protocol.datagram import Datagram
from protocol.devices.rtde.wires import Port
from tools import external_control, register_program

FOLDER = Path(__file__).resolve().parent.parent / "tests" / "wire" / "transcripts" / "clients"
EPOCH = 4321.0
"""Time of a device's power-up, s. Chosen: not 0, so that devices that count from 0 are detected."""
BOOTED_S = 10.0
"""Time from the power-up of a board on a CAN bus to the first step, s. Chosen: the board receives nothing while it
boots.
"""
SEED = 1
START = StartPose((0.9, -0.1, 0.6), (0.0, 1.0, 0.0, 0.0), 0.2)
WRENCH = (1.5, -2.5, 10.0, 0.1, -0.2, 0.3)
"""Constant wrench on the sensor, N and N·m."""
OPENS, CLOSES = "opens", "closes"
CLIENT, DEVICE = "client", "device"
SERVICES = external_control.SERVICES
CAN = "can"
"""Name of the wire on which each step is one CAN frame: its identifier in two bytes, then its data."""
DATAGRAMS = ("egm", "rsi", "rdt", CAN)
"""Wires on which each step is one datagram or frame. Other wires carry bytes."""


class Step(NamedTuple):
    """Event on a wire."""

    at_ms: float
    """Time since power-up, ms."""
    side: str
    """`CLIENT` or `DEVICE`."""
    wire: str
    """Name of the wire: `egm`, `rsi`, `rdt`, `can` and `serial`, or a TCP port with the number of its connection, as
    `rtde-1`. A port of the client, to which a program at the device connects, has the name of its service: `reverse-1`.
    """
    data: bytes = b""
    event: str = ""
    """Event: `OPENS` or `CLOSES`, without data. If the device connects, its step precedes the step of the client,
    which accepts.
    """

    @property
    def now(self) -> float:
        """Time of the step on the device's clock, s."""
        return EPOCH + self.at_ms / 1e3


@dataclass
class Transcript:
    """Session of a client."""

    head: dict[str, str]
    """Header: `client` with its version, `recorded` (the day), `device`, and `settings` of the device in JSON."""
    steps: list[Step] = field(default_factory=list)
    reads: list[Any] = field(default_factory=list)
    sends: list[Any] = field(default_factory=list)

    def made_by(self, side: str, wire: str) -> list[bytes]:
        """Return all data that one side sent on a wire. `rtde` includes all its connections."""
        return [
            step.data
            for step in self.steps
            if step.data and (step.side, step.wire.split("-")[0]) == (side, wire)
        ]


def write(transcript: Transcript, path: Path) -> None:
    """Write the transcript to a file."""
    lines = [f"{key}: {value}" for key, value in transcript.head.items()]
    lines += (
        f"{step.at_ms:10.3f} {step.side} {step.wire} {step.event or written(step.data)}"
        for step in transcript.steps
    )
    for key, values in (("reads", transcript.reads), ("sends", transcript.sends)):
        lines += (f"{key}: {json.dumps(value)}" for value in values)
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def read(path: Path) -> Transcript:
    """Read the transcript from a file."""
    transcript = Transcript({})
    for line in path.read_text(encoding="ascii").splitlines():
        if line[0] == " ":
            at, side, wire, what = line.split(maxsplit=3)
            event = what if what in (OPENS, CLOSES) else ""
            transcript.steps.append(Step(float(at), side, wire, b"" if event else octets(what), event))
            continue
        key, _, value = line.partition(": ")
        if key == "reads":
            transcript.reads.append(json.loads(value))
        elif key == "sends":
            transcript.sends.append(json.loads(value))
        else:
            transcript.head[key] = value
    return transcript


def written(data: bytes) -> str:
    """Format data for a file."""
    is_text = all(byte in b"\r\n\t" or 32 <= byte < 127 for byte in data)
    return json.dumps(data.decode("ascii")) if is_text else data.hex()


def octets(text: str) -> bytes:
    """Parse data from the text in a file."""
    return json.loads(text).encode("ascii") if text.startswith('"') else bytes.fromhex(text)


class Stage:
    """Emulated device and the ends of its wires, with a clock that the caller advances."""

    def __init__(self, device: str, settings: Mapping[str, Any]) -> None:
        self._ends: dict[str, Any] = {}
        self._sockets: dict[str, ProgramSocket] = {}
        """Ends of a program's connections, as the program at the device uses them."""
        self._opened: list[str] = []
        """Wires that a program has opened since the last output of the device."""
        self._device: Any
        match device:
            case "egm":
                self._device = EgmController(EgmProfile(**settings), START, EPOCH, SEED)
                self._ends["egm"] = self._device.endpoint
            case "rsi":
                self._device = RsiController(RsiProfile(**settings), START, EPOCH, SEED)
                self._ends["rsi"] = self._device.endpoint
            case "netft":
                self._device = NetBox(NetFtProfile(**settings), KnownWrench(_wrench_at), EPOCH, SEED)
                self._ends["rdt"] = self._device.endpoint
            case "ati-can":
                self._device = AtiCanBoard(
                    AtiCanProfile(**settings), KnownWrench(_wrench_at), EPOCH - BOOTED_S, SEED
                )
                self._ends[CAN] = self._device.endpoint
            case "ft300":
                self._device = Ft300(Ft300Profile(**settings), KnownWrench(_wrench_at), EPOCH, SEED)
                self._ends["serial"] = self._device.endpoint
            case "rtde":
                self._device = RtdeRobot(RtdeProfile(**settings), START, EPOCH, SEED)
                self._device.controller.console.open_socket = self._open_for_program
            case _:
                raise ValueError(f"no stage for {device}")

    def next_deadline(self) -> float | None:
        """Return the time at which the device has its next action, s on its clock."""
        return min(
            (due for end in self._ends.values() if (due := end.next_deadline()) is not None), default=None
        )

    def advance(self, until: float) -> Iterator[Step]:
        """Advance the device to this time, s. Return the device's output."""
        while (due := self.next_deadline()) is not None and due <= until:
            for end in tuple(self._ends.values()):
                if end.next_deadline() == due:
                    end.handle_deadline(due)
            yield from self._said(due)

    def take(self, step: Step) -> Iterator[Step]:
        """Execute a step of the client. Return the immediate answer of the device.

        All events that are due before the step must have been processed.
        """
        port = step.wire.partition("-")[0]
        if step.wire in self._sockets:
            self._take_of_program(step)
        elif step.event == OPENS:
            self._ends[step.wire] = (
                PageEndpoint(self._device) if port == "page" else self._device.connect(Port(port), step.now)
            )
        elif step.event == CLOSES:
            end = self._ends.pop(step.wire)
            if port != "page":
                self._device.leave(Port(port), end, step.now)
        elif port == CAN:
            self._ends[CAN].receive([read_frame(step.data)], step.now)
        elif port in DATAGRAMS:
            self._ends[step.wire].receive([Datagram(step.data, step.now, CLIENT)], step.now)
        else:
            data = _played_form(step.data) if port in (Port.SCRIPT, Port.PRIMARY) else step.data
            self._ends[step.wire].receive(data, step.now)
        yield from self._said(step.now)

    def _open_for_program(self, host: str, port: int) -> ProgramSocket:
        """Connect a program at the device to its client."""
        wire = f"{SERVICES[port]}-{len(self._sockets) + 1}"
        self._ends[wire], self._sockets[wire] = self._device.connect_program(self._device.controller.now)
        self._opened.append(wire)
        return self._sockets[wire]

    def _take_of_program(self, step: Step) -> None:
        """Act as the client on a connection that a program opened: accept it, send on it, or close it."""
        if step.event == OPENS:
            self._sockets[step.wire].opened()
        elif step.event == CLOSES:
            self._ends.pop(step.wire).close(step.now)
        else:
            self._ends[step.wire].receive(step.data, step.now)

    def _said(self, now: float) -> Iterator[Step]:
        at_ms = round((now - EPOCH) * 1e3, 3)
        while self._opened:
            yield Step(at_ms, DEVICE, self._opened.pop(0), event=OPENS)
        for wire, end in tuple(self._ends.items()):
            if not (data := end.data_to_send(now)):
                continue
            for part in data if wire in DATAGRAMS else [data]:
                yield Step(at_ms, DEVICE, wire, write_frame(part) if wire == CAN else bytes(part))
        for wire, socket in self._sockets.items():
            if socket.closing and wire in self._ends:
                self._ends.pop(wire).close(now)
                yield Step(at_ms, DEVICE, wire, event=CLOSES)


def read_frame(data: bytes) -> CanFrame:
    """Parse a CAN frame from the bytes in a file."""
    return CanFrame(int.from_bytes(data[:2], "big"), data[2:])


def write_frame(frame: CanFrame) -> bytes:
    """Format a CAN frame for a file."""
    return frame.identifier.to_bytes(2, "big") + frame.data


def _played_form(data: bytes) -> bytes:
    """Return text for a robot, with our programs in place of the short forms of third-party programs."""
    return external_control.played_form(register_program.played_form(data))


def _wrench_at(times: Floats) -> Floats:
    return np.tile(np.array(WRENCH), (len(times), 1))


def replayed(transcript: Transcript) -> list[Step]:
    """Return the answers that the current device gives to the steps of the client."""
    stage = Stage(transcript.head["device"], json.loads(transcript.head["settings"]))
    answers: list[Step] = []
    for step in transcript.steps:
        if step.side == CLIENT:
            answers += stage.advance(step.now)
            answers += stage.take(step)
    return answers + list(stage.advance(transcript.steps[-1].now))
