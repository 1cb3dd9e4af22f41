"""Record transcripts of third-party clients with our emulated devices: `python -m tools.record_clients`.

Each client runs unmodified in its own environment and process, over real wires of this computer; names select some of
`SESSIONS`. The device's time follows the computer's in steps of 0.1 ms, so that the file replays exactly. The text of a
robot program belongs to its author, so a line with its name replaces it.
"""

import argparse
import datetime
import json
import os
import pty
import re
import selectors
import socket
import subprocess
import tempfile
import time
import tty
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple

from tools.client_environments import interpreter
from tools.client_scripts import SESSIONS, Session
from tools.client_transcripts import CLIENT, CLOSES, EPOCH, FOLDER, OPENS, Stage, Step, Transcript, write
from tools.register_program import recorded_form

HOST = "127.0.0.77"
"""Separate address for a client with constant port numbers."""
PATIENCE_S = 60.0
TAIL = 3
"""Number of the device's steps that are kept after the client's last step. Chosen: enough to show that the device
continues.
"""
TICK_S = 0.02
"""Maximum time between two checks of the client, s."""

_PROGRAM_NAME, _PROGRAM_END = (
    re.compile(rb"^def\s+(\w+)\s*\(", re.MULTILINE),
    re.compile(rb"^end\r?\n", re.MULTILINE),
)


class Wire(NamedTuple):
    """Listening end of a wire on this computer."""

    name: str
    file: Any
    receive: Callable[[], bytes]
    send: Callable[[bytes], object]


class Recorder:
    """Device with its wires, and a recording of their traffic."""

    def __init__(self, session: Session, stack: ExitStack) -> None:
        self._stack = stack
        self._stage = Stage(session.device, session.settings)
        self._selector = stack.enter_context(selectors.DefaultSelector())
        self._wires: dict[str, Wire] = {}
        self._programs: dict[str, bytes] = {}
        self._opened = 0
        self.steps: list[Step] = []
        self.began = time.monotonic()
        self.arguments: dict[str, str] = {"host": HOST}
        """Arguments of the client's program, by name."""
        for wire, port in session.wires.items():
            self._open(wire, port)

    def _open(self, wire: str, port: int) -> None:
        match wire:
            case "egm" | "rsi":
                here = self._datagrams((HOST, 0))
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                    probe.bind((HOST, 0))
                    there = probe.getsockname()
                self._watch(Wire(wire, here, lambda: here.recv(4096), lambda data: here.sendto(data, there)))
                self.arguments["port"] = str(there[1])
            case "rdt":
                box, side = self._datagrams((HOST, port)), [("", 0)]

                def receive() -> bytes:
                    data, side[0] = box.recvfrom(4096)
                    return data

                self._watch(Wire(wire, box, receive, lambda data: box.sendto(data, side[0])))
                self.arguments["port"] = str(box.getsockname()[1])
            case "serial":
                master, slave = pty.openpty()
                tty.setraw(slave)
                self._watch(
                    Wire(wire, master, lambda: os.read(master, 4096), lambda data: os.write(master, data))
                )
                self.arguments["port"] = os.ttyname(slave)
            case _:
                listening = self._stack.enter_context(socket.create_server((HOST, port)))
                self._selector.register(listening, selectors.EVENT_READ, (wire, listening))
                self.arguments[wire] = str(listening.getsockname()[1])

    def _datagrams(self, address: tuple[str, int]) -> socket.socket:
        made = self._stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        made.bind(address)
        return made

    def _watch(self, wire: Wire) -> None:
        self._wires[wire.name] = wire
        self._selector.register(wire.file, selectors.EVENT_READ, wire)

    def start(self) -> None:
        """Power up the device now."""
        self.began = time.monotonic()

    def turn(self) -> None:
        """Wait for the device or the client, and process their data."""
        due = self._stage.next_deadline()
        wait = TICK_S if due is None else min(due - EPOCH + self.began - time.monotonic(), TICK_S)
        ready = self._selector.select(max(wait, 0.0))
        at_ms = round((time.monotonic() - self.began) * 1e3, 1)
        now = Step(at_ms, CLIENT, "").now
        for step in self._stage.advance(now):
            self._say(step)
        for key, _ in ready:
            if isinstance(key.data, Wire):
                self._hear(key.data, at_ms)
            else:
                port, listening = key.data
                self._accept(port, listening, at_ms)

    def _accept(self, port: str, listening: socket.socket, at_ms: float) -> None:
        self._opened += 1
        connection = self._stack.enter_context(listening.accept()[0])
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        wire = Wire(f"{port}-{self._opened}", connection, lambda: connection.recv(65536), connection.sendall)
        self._watch(wire)
        self._take(Step(at_ms, CLIENT, wire.name, event=OPENS))

    def _hear(self, wire: Wire, at_ms: float) -> None:
        try:
            data = wire.receive()
        except ConnectionResetError:
            data = b""
        except ConnectionRefusedError:  # a UDP client that has ended or has not started yet
            return
        taken = self._without_program(wire.name, data) if wire.name.startswith("script") else data
        if taken:
            self._take(Step(at_ms, CLIENT, wire.name, taken))
        if not data or (wire.name.startswith("page") and self.steps[-1].side != CLIENT):
            self._take(Step(at_ms, CLIENT, wire.name, event=CLOSES))
            self._selector.unregister(wire.file)
            del self._wires[wire.name]
            wire.file.close()

    def _without_program(self, wire: str, data: bytes) -> bytes:
        """Return the data of a script port in the form that is recorded.

        Each complete program is replaced by another that the device knows by the same name and registers, because
        the text belongs to its author.
        """
        text = self._programs[wire] = self._programs.get(wire, b"") + data
        if (end := _PROGRAM_END.search(text)) is None:
            return b""
        self._programs[wire] = text[end.end() :]
        name = next(iter(_PROGRAM_NAME.findall(text)), b"unknown")
        return recorded_form(name, text)

    def _take(self, step: Step) -> None:
        self.steps.append(step)
        for answer in self._stage.take(step):
            self._say(answer)

    def _say(self, step: Step) -> None:
        self.steps.append(step)
        with suppress(ConnectionError):  # the client has disconnected
            self._wires[step.wire].send(step.data)


def record(session: Session) -> Transcript:
    """Record one session. Raises RuntimeError if the client fails."""
    head = {
        "client": session.client[0].replace("==", " "),
        "recorded": f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}",
        "device": session.device,
        "settings": json.dumps(session.settings),
    }
    with ExitStack() as stack:
        recorder = Recorder(session, stack)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for name, text in session.files.items():
            (folder / name).write_text(text.format(**recorder.arguments), encoding="utf-8")
        process = stack.enter_context(
            subprocess.Popen(
                [interpreter(*session.client), "-c", session.script, *recorder.arguments.values()],
                cwd=folder,
                stdout=subprocess.PIPE,
                text=True,
            )
        )
        stack.callback(process.kill)
        assert process.stdout is not None
        if session.waits:
            line = process.stdout.readline()
            while line and line != "ready\n":
                line = process.stdout.readline()
        recorder.start()
        ends = time.monotonic() + PATIENCE_S
        while process.poll() is None and time.monotonic() < ends:
            recorder.turn()
        output = process.stdout.read()
    if process.returncode:
        raise RuntimeError(f"{session.client[0]} ended with exit code {process.returncode}\n{output}")
    values = json.loads(output.splitlines()[-1])
    last = max(number for number, step in enumerate(recorder.steps) if step.side == CLIENT)
    return Transcript(
        head, recorder.steps[: last + 1 + TAIL], values.get("reads", []), values.get("sends", [])
    )


def main(arguments: list[str] | None = None) -> None:
    """Record all sessions, or the named ones."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(SESSIONS)}; by default all")
    for name in parser.parse_args(arguments).names or SESSIONS:
        path = FOLDER / f"{name}.txt"
        write(record(SESSIONS[name]), path)
        print(f"{path.relative_to(Path.cwd())}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
