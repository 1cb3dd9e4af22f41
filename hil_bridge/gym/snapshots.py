"""Snapshots of episodes at their first decision, and episodes that begin at them. See `cell_process`."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import warnings
import weakref
from contextlib import suppress
from multiprocessing.spawn import get_executable
from operator import attrgetter, methodcaller
from pathlib import Path
from typing import Any, cast

from hil_bridge.errors import ConfigError
from hil_bridge.gym.cell_process import BEGIN, Arrival, ProcessLost, Request
from hil_bridge.gym.channel import Channel
from hil_bridge.gym.episode import Choice, Decision, EpisodeEnd, EpisodeSettings
from hil_bridge.record.kept import KeptRecords
from hil_bridge.record.reader import RawTraffic, Recording
from hil_bridge.runs.simulation import with_records

SUPPORTED = hasattr(os, "fork")
"""Whether this system can copy a process, and therefore keep snapshots."""
PATIENCE_S = 10.0
"""Time until processes that do not end are killed, s. Chosen: they end when they next use their channel."""
_PROGRAM = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[2]); "
    "from hil_bridge.gym.cell_process import serve; serve(int(sys.argv[1]))"
)
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Variables by which numerical libraries start no threads: only a process with one thread can be copied safely."""


class CellProcess:
    """Process that has loaded the program, and forks a process for each snapshot. All environments of a process share
    it; it ends with the last of them.
    """

    @classmethod
    def shared(cls) -> "CellProcess":
        """Return the process of this process's environments; start it if necessary."""
        cell = _CELL_PROCESSES.get(os.getpid())
        if cell is None or cell._process.poll() is not None:
            cell = _CELL_PROCESSES[os.getpid()] = cls()
        return cell

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [get_executable(), "-c", _PROGRAM, str(theirs.fileno()), json.dumps(sys.path)],
                stdin=subprocess.DEVNULL,
                env=os.environ | _ONE_THREAD,
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # Ctrl-C is for the user's process
            )
        self._control = ours
        self._channels = [Channel(ours)]
        """The first end of each channel: of the process, and of its copies."""
        self._lock = threading.Lock()
        weakref.finalize(self, _end, self._process, self._channels)

    def open_channel(self) -> Channel:
        """Return a channel to a new copy of the process. Raises ProcessLost if the process has ended."""
        ours, theirs = socket.socketpair()
        try:
            with theirs:
                socket.send_fds(self._control, [b"."], [theirs.fileno()])
        except OSError as error:
            ours.close()
            raise ProcessLost("the process of the emulated cells has ended") from error
        channel = Channel(ours)
        with self._lock:
            self._channels[:] = [*(one for one in self._channels if one.is_open), channel]
        return channel


_CELL_PROCESSES: "weakref.WeakValueDictionary[int, CellProcess]" = weakref.WeakValueDictionary()
"""Processes of the cells, by the number of the process whose environments share them."""


def _end(process: "subprocess.Popen[bytes]", channels: list[Channel]) -> None:
    """End a process and its copies, unless they belong to another process that this one is a copy of."""
    is_ours = channels[0].is_ours
    for channel in channels:
        channel.close()
    if is_ours:
        try:
            process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    else:
        process.returncode = 0  # not to be waited for here


class Snapshot:
    """Episode at its first decision, which can be executed any number of times."""

    def __init__(self, settings: EpisodeSettings) -> None:
        """Run an episode to its first decision. Raises ConfigError for a configuration that cannot be run."""
        self._cell = CellProcess.shared()
        self._channel = self._cell.open_channel()
        self._episode = 0
        self._is_playing = False
        try:
            arrival: Arrival = self._exchange(settings)
        except BaseException:
            self.close()
            raise
        for text in arrival.warnings:
            warnings.warn(text, stacklevel=2)
        self._first = arrival.first

    def start(self) -> Decision | EpisodeEnd:
        """Begin an episode. Raises ProcessLost if the process of the snapshot has ended."""
        self.leave()
        if isinstance(self._first, EpisodeEnd):
            return self._first
        self._episode, self._is_playing = self._episode + 1, True
        self._exchange(BEGIN)
        return self._first

    def act(self, choice: Choice) -> Decision | EpisodeEnd:
        """Apply an action and run to the next decision. Raises ProcessLost if the process of the episode has ended."""
        answer: Decision | EpisodeEnd = self._exchange(choice)
        if isinstance(answer, EpisodeEnd) and answer.result is not None:
            records = cast(KeptRecords, _RemoteRecords(self, self._episode))
            return answer._replace(result=with_records(answer.result, records))
        return answer

    def fetch(self, episode: int, request: Request) -> Any:
        """Return a value of the records of the episode with this number. Raises ConfigError after the next one has
        begun.
        """
        if not self._is_playing or episode != self._episode:
            raise ConfigError(
                "the records of an episode are available until the next reset of its environment"
            )
        return self._exchange(request)

    def leave(self) -> None:
        """Abandon the episode. Idempotent."""
        if self._is_playing:
            self._is_playing = False
            if not self._channel.is_ours:
                return
            with suppress(OSError):
                self._channel.send(None)

    def close(self) -> None:
        """End the process of the snapshot. Idempotent."""
        self._is_playing = False
        self._channel.close()

    def _exchange(self, message: object) -> Any:
        if not self._channel.is_ours:
            raise ProcessLost(
                "the episode belongs to the process that this one is a copy of; call reset() first"
            )
        try:
            self._channel.send(message)
            answer = self._channel.receive()
        except (OSError, EOFError) as error:
            self.close()
            raise ProcessLost("the process of the emulated cell has ended; reset() starts another") from error
        except BaseException:  # an interrupt: the answer is still to come
            self.close()
            raise
        if isinstance(answer, ProcessLost):
            self.close()
        if isinstance(answer, BaseException):
            raise answer
        return answer


class _RemoteRecords:
    """Records of an episode that has ended, which are still in its process."""

    def __init__(self, snapshot: Snapshot, episode: int) -> None:
        self._snapshot, self._episode = snapshot, episode

    def recording(self) -> Recording:
        """Return the recording."""
        recording: Recording = self._snapshot.fetch(self._episode, methodcaller("recording"))
        return recording

    @property
    def traffic(self) -> RawTraffic:
        """Raw traffic of the wires."""
        traffic: RawTraffic = self._snapshot.fetch(self._episode, attrgetter("traffic"))
        return traffic

    def save(self, path: Path, overwrite: bool = False) -> None:
        """Write the recording to a file."""
        self._snapshot.fetch(self._episode, methodcaller("save", path.absolute(), overwrite))


class Snapshots:
    """Snapshots by the seed of their episode. The least recently used one is closed if there are too many."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._owner = os.getpid()
        self._parked: dict[int, Snapshot] = {}

    def start(self, settings: EpisodeSettings) -> tuple[Snapshot, Decision | EpisodeEnd]:
        """Begin an episode at its snapshot. Raises ConfigError for a configuration that cannot be run."""
        if self._owner != os.getpid():  # this process is a copy, and the snapshots belong to the original
            self.close()
            self._owner = os.getpid()
        if (snapshot := self._parked.pop(settings.seed, None)) is not None:
            self._parked[settings.seed] = snapshot  # as the most recently used one
            with suppress(ProcessLost):
                return snapshot, snapshot.start()
            del self._parked[settings.seed]
        while len(self._parked) >= self._most:
            self._parked.pop(next(iter(self._parked))).close()
        snapshot = Snapshot(settings)
        first = snapshot.start()
        if isinstance(first, Decision):
            self._parked[settings.seed] = snapshot
        else:
            snapshot.close()
        return snapshot, first

    def close(self) -> None:
        """Close all snapshots. Idempotent."""
        while self._parked:
            self._parked.popitem()[1].close()
