"""Client under test: a separate process with its children, and the end of its output."""

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
"""Chosen: number of last bytes kept of a client's output."""
_REAP_S = 2.0
"""Chosen: timeout for the end of a killed process."""


@dataclass(frozen=True, slots=True)
class Where:
    """Address of the device for a client."""

    url: str
    """Link URL of hil-bridge, with the kind if required."""
    names: Mapping[str, str]
    """Placeholders by name: url, host, port and others of the link."""

    def environment(self) -> dict[str, str]:
        """Return this process's environment with `HIL_BRIDGE_HOST` and so on. Python clients write unbuffered."""
        given = {f"HIL_BRIDGE_{name.upper()}": value for name, value in self.names.items()}
        return {**os.environ, "PYTHONUNBUFFERED": "1", **given}

    def filled(self, command: Sequence[str]) -> list[str]:
        """Fill in the placeholders of a command. Raises ConfigError for a placeholder that this link does not have."""
        filled = []
        for word in command:
            for name, value in self.names.items():
                word = word.replace(f"{{{name}}}", value)
            for name in ("url", "host", "port", "device", "dashboard", "script"):
                if f"{{{name}}}" in word:
                    raise ConfigError(
                        f"unknown placeholder {{{name}}} for this link; "
                        f"known: {', '.join(f'{{{key}}}' for key in self.names)}"
                    )
            filled.append(word)
        return filled


class Client(Protocol):
    """Client of a device that runs by itself."""

    on_output: Callable[[bytes], object] | None
    """Called with each piece of its output; None to ignore it."""

    def start(self, where: Where) -> None:
        """Start the client. Raises ConfigError if it cannot be started."""

    def poll(self) -> int | None:
        """Return its exit code, negative for a signal; None while it runs."""

    def ask_to_end(self) -> None:
        """Ask it to terminate."""

    def kill(self) -> None:
        """Kill it and all its children. Idempotent."""

    @property
    def output(self) -> str:
        """The end of its output."""


class ProcessClient:
    """Command in a new session, so that signals reach all its processes."""

    def __init__(self, command: Sequence[str]) -> None:
        self._command = command
        self.on_output: Callable[[bytes], object] | None = None
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
        # Not reaped before `kill`: its process group number must not be reused.
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
        """Signal the complete group, even if its leader has ended: the rest are its children."""
        assert self._process is not None
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, number)

    def _read(self) -> None:
        """Read its output, for a limited time: a client that writes without end must not block."""
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
            if self.on_output is not None:
                self.on_output(piece)
            self._cut |= len(self._tail) + len(piece) > OUTPUT_MAX
            self._tail = (self._tail + piece)[-OUTPUT_MAX:]
