"""Processes of the emulated cells: one that has loaded the program, and a copy of it for each snapshot.

A copy runs its episode to the first decision and waits there. For each episode it forks: the child continues the run
with the actions that it receives, while the parent keeps the snapshot and waits for the end of the child. Parent and
child use the same channel in turns. If the process of the user ends, all channels end, and with them all processes.
"""

import asyncio
import gc
import os
import pickle
import signal
import socket
import traceback
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple, NoReturn, TypeAlias

from hil_bridge.errors import BridgeError
from hil_bridge.gym.channel import Channel
from hil_bridge.gym.episode import Choice, Decision, EpisodeEnd, EpisodeRun, EpisodeSettings
from hil_bridge.record.kept import KeptRecords
from hil_bridge.runs.simulation import with_records

BEGIN = "begin"
"""Request to a snapshot: play an episode."""
BEGUN = "begun"
"""Answer of the process that plays the episode."""
Request: TypeAlias = Callable[[KeptRecords], Any]
"""Request to an episode that has ended: return a value of its records."""


class Arrival(NamedTuple):
    """First message of a snapshot."""

    first: Decision | EpisodeEnd
    """First decision, or the end of a run that reaches none."""
    warnings: tuple[str, ...]
    """Warnings that the run issued until then."""


class ProcessLost(BridgeError):
    """End of a process of the cell for another reason than its own program."""


def serve(descriptor: int) -> None:
    """Fork a process for each channel that arrives through a socket, until the socket is closed."""
    control = socket.socket(fileno=descriptor)
    while True:
        data, ends, _, _ = socket.recv_fds(control, 1, 1)
        if not data:
            break
        channel = Channel(socket.socket(fileno=ends[0]))
        with suppress(OSError, EOFError):
            settings: EpisodeSettings = channel.receive()
            _warm_up(settings)
            if os.fork() == 0:
                control.close()
                _play(channel, settings)
        channel.drop()
        _reap(os.WNOHANG)
    _reap(0)


def _reap(options: int) -> None:
    """Collect the exit statuses of children that have ended; wait for all of them if `options` is 0."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, options)[0]:
            pass


def _warm_up(settings: EpisodeSettings) -> None:
    """Load the devices of a configuration, so that copies of this process need not."""
    with suppress(Exception):  # the copy reports it
        settings.config()
    gc.collect()
    gc.freeze()  # memory that the collector does not touch stays shared


def _play(channel: Channel, settings: EpisodeSettings) -> NoReturn:
    """Carry out the run of a snapshot in this process, and end the process."""
    with suppress(OSError, EOFError):
        player = _Player(channel)
        answer: object
        try:
            with warnings.catch_warnings(record=True) as player.warnings:
                warnings.simplefilter("always")
                end = EpisodeRun(settings, player.decide).carry_out()
            answer = player.conclude(end)
        except BaseException as error:  # for the other process, which waits
            answer = _portable(error)
        channel.send(answer)
        while player.is_playing and (request := channel.receive()) is not None:
            channel.send(player.fetch(request))
    os._exit(0)


class _Player:
    """Run of a snapshot, as its process sees it."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._records: KeptRecords | None = None
        self.warnings: list[warnings.WarningMessage] | None = None
        self.is_playing = False
        """Whether this process plays an episode; otherwise it has not reached the snapshot."""

    def decide(self, decision: Decision) -> Choice:
        """Return the choice for a decision. Wait at the first one, and return from it in the child of each episode."""
        try:
            if self.is_playing:
                self._channel.send(decision)
            else:
                self._channel.send(self._arrival(decision))
                self._wait()
            choice: Choice | None = self._channel.receive()
        except (OSError, EOFError):
            choice = None
        if choice is None:
            os._exit(0)
        return choice

    def _arrival(self, first: Decision | EpisodeEnd) -> Arrival:
        texts = (str(one.message) for one in self.warnings or () if one.category is UserWarning)
        return Arrival(first, tuple(texts))

    def _wait(self) -> None:
        """Wait at the snapshot. Return in the child of each episode only."""
        gc.collect()
        gc.freeze()
        loop = asyncio.get_running_loop()
        while self._channel.receive() == BEGIN:
            try:
                child = os.fork()
            except OSError as error:
                self._channel.send(_portable(error))
                continue
            if child == 0:
                asyncio._set_running_loop(loop)  # asyncio forgets it in a copy of the process
                self.is_playing = True
                self._channel.send(BEGUN)
                return
            _, status = os.waitpid(child, 0)
            if status:
                self._channel.send(ProcessLost(f"the process of the episode {_describe(status)}"))
        os._exit(0)

    def conclude(self, end: EpisodeEnd) -> Arrival | EpisodeEnd:
        """Return the last message of the run. The records stay in this process."""
        if end.result is not None:
            self._records = end.result._records
            end = end._replace(result=with_records(end.result, None))
        return end if self.is_playing else self._arrival(end)

    def fetch(self, request: Request) -> object:
        """Return a value of the records, or the exception of the request."""
        try:
            assert self._records is not None, "the run has no records"
            return request(self._records)
        except Exception as error:
            return _portable(error)


def _describe(status: int) -> str:
    """Describe the end of a process from its status of `os.waitpid`."""
    code = os.waitstatus_to_exitcode(status)
    if code >= 0:
        return f"ended with the exit code {code}"
    with suppress(ValueError):
        return f"was killed by the signal {signal.Signals(-code).name}"
    return f"was killed by the signal {-code}"


def _portable(error: BaseException) -> BaseException:
    """Return an error that can be pickled, with the place where it was raised if it is not one for the operator."""
    if not isinstance(error, BridgeError):
        error.add_note("In the process of the cell:\n" + "".join(traceback.format_exception(error)))
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        other = RuntimeError(repr(error))
        other.add_note("\n".join(error.__notes__) if hasattr(error, "__notes__") else "")
        return other
    return error
