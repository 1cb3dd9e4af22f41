"""The client that is judged: a process of its own, with all that it starts, and the end of its output."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

from hil_bridge.errors import ConfigError

OUTPUT_MAX = 64 * 1024
"""Chosen: bytes of a client's output that are kept, the last ones."""
_REAP_S = 2.0
"""Chosen: for how long the end of a process that was killed is waited for."""


@dataclass(frozen=True, slots=True)
class Where:
    """How a client finds the device."""

    url: str
    """The wire as hil-bridge writes it, with the kind where it needs one."""
    names: Mapping[str, str]
    """Placeholders by name: url, host, port and what else the wire has."""

    def environment(self) -> dict[str, str]:
        """`HIL_BRIDGE_HOST` and so on, beside what this process has. A client in Python tells each line at once."""
        given = {f"HIL_BRIDGE_{name.upper()}": value for name, value in self.names.items()}
        return {**os.environ, "PYTHONUNBUFFERED": "1", **given}

    def filled(self, command: Sequence[str]) -> list[str]:
        """The command with its placeholders filled in. Raises ConfigError for one that this wire does not have."""
        filled = []
        for word in command:
            for name, value in self.names.items():
                word = word.replace(f"{{{name}}}", value)
            for name in ("url", "host", "port", "device", "dashboard", "script"):
                if f"{{{name}}}" in word:
                    raise ConfigError(
                        f"{{{name}}}: this wire has none; there are {', '.join(f'{{{key}}}' for key in self.names)}"
                    )
            filled.append(word)
        return filled


class Client(Protocol):
    """Something that comes to a device by itself."""

    hear: Callable[[bytes], object] | None
    """Called with each piece of its output; None while it is not wanted."""

    def start(self, where: Where) -> None:
        """Begin. Raises ConfigError for what cannot be started."""

    def poll(self) -> int | None:
        """Its exit code, minus the number of a signal; None while it continues."""

    def ask_to_end(self) -> None:
        """Tell it to end."""

    def kill(self) -> None:
        """End it, and all that it has started; harmless when it has ended."""

    @property
    def output(self) -> str:
        """The end of its output."""


class ProcessClient:
    """A command in a session of its own, so that all its processes are reached."""

    def __init__(self, command: Sequence[str]) -> None:
        self._command = command
        self.hear: Callable[[bytes], object] | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._tail = b""
        self._cut = False

    def start(self, where: Where) -> None:
        words = where.filled(self._command)
        try:
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env=where.environment(),
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"cannot start {words[0]!r}: {getattr(error, 'strerror', '') or error}"
            ) from error
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), False)

    def poll(self) -> int | None:
        if self._process is None:
            return None
        self._read()
        ended = os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if ended is None:
            return None
        # Not reaped before `kill`: its number stays that of its group, so that no stranger's group has it.
        self._read()
        return ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status

    def ask_to_end(self) -> None:
        self._signal(signal.SIGTERM)

    def kill(self) -> None:
        process = self._process
        if process is None:
            return
        self._signal(signal.SIGKILL)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_REAP_S)
        self._read()
        if process.stdout is not None:
            process.stdout.close()
        self._process = None

    @property
    def output(self) -> str:
        text = self._tail.decode("utf-8", "backslashreplace")
        return f"[…]{text}" if self._cut else text

    def _signal(self, number: signal.Signals) -> None:
        """To the whole group, also when its leader has ended: it began what is left there."""
        assert self._process is not None
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, number)

    def _read(self) -> None:
        """Take what it has written, and not more than so much at a time: one that writes for ever is not waited for."""
        assert self._process is not None
        stream = self._process.stdout
        if stream is None or stream.closed:
            return
        until = time.monotonic() + 0.01
        while time.monotonic() < until:
            try:
                piece = os.read(stream.fileno(), OUTPUT_MAX)
            except BlockingIOError:
                return
            if not piece:
                return
            if self.hear is not None:
                self.hear(piece)
            self._cut |= len(self._tail) + len(piece) > OUTPUT_MAX
            self._tail = (self._tail + piece)[-OUTPUT_MAX:]
