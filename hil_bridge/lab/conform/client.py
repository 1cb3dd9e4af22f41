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
"""Number of bytes kept from the end of a client's output. Chosen."""
_REAP_S = 2.0
"""Timeout for the end of a killed process, s. Chosen."""


@dataclass(frozen=True, slots=True)
class Where:
    """Address of the device for a client."""

    url: str
    """Link URL in the format of hil-bridge, with the device kind if required."""
    names: Mapping[str, str]
    """Values of the placeholders by name: url, host, port and others of the link."""

    def environment(self) -> dict[str, str]:
        """Return this process's environment with `HIL_BRIDGE_HOST` and the other address variables. Python clients
        write unbuffered.
        """
        variables = {f"HIL_BRIDGE_{name.upper()}": value for name, value in self.names.items()}
        return {**os.environ, "PYTHONUNBUFFERED": "1", **variables}

    def filled(self, command: Sequence[str]) -> list[str]:
        """Replace the placeholders of a command by their values. Raises ConfigError for a placeholder that this
        link does not have.
        """
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
    """Client under test, which runs independently of the test."""

    on_output: Callable[[bytes], object] | None
    """Callback that receives each piece of output; None to discard the output."""

    def start(self, where: Where) -> None:
        """Start the client. Raises ConfigError if it cannot be started."""

    def poll(self) -> int | None:
        """Return the exit code of the client, negative for a signal; None while it runs."""

    def ask_to_end(self) -> None:
        """Ask the client to terminate."""

    def kill(self) -> None:
        """Kill the client and all its children. Idempotent."""

    @property
    def output(self) -> str:
        """End of the client's output as text."""


class ProcessClient:
    """Client that is a command in a new session, so that signals reach all its processes."""

    def __init__(self, command: Sequence[str]) -> None:
        self._command = command
        self.on_output: Callable[[bytes], object] | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._tail = b""
        self._cut = False

    def start(self, where: Where) -> None:
        command = where.filled(self._command)
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env=where.environment(),
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            raise ConfigError(
                f"cannot start {command[0]!r}: {getattr(error, 'strerror', '') or error}"
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
        """Send a signal to the complete process group, even if its leader has ended, because children may remain."""
        assert self._process is not None
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, number)

    def _read(self) -> None:
        """Read the output for a limited time, so that a client that never stops writing cannot block the test."""
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
