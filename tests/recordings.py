"""Recordings that tests only read: each run is made once per test run, even with several test processes.

A test that checks how a run is made, repeats it or watches it makes its own run.
"""

import fcntl
import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from hil_bridge import api
from hil_bridge.runs.recorded import Recording

Settings = Mapping[str, Any]
Faults = Sequence[Mapping[str, Any]]
KEPT = 8
"""Number of recordings that a process keeps in memory."""


class Recordings:
    """Folder of recordings of runs in virtual time, by everything such a run depends on: its complete configuration.

    That includes the devices, the faults and the seed. Files that a configuration names must not change meanwhile.
    """

    def __init__(self, folder: Path) -> None:
        """`folder` is shared by the processes of one test run only."""
        self._folder = folder
        folder.mkdir(exist_ok=True)
        self._read = lru_cache(KEPT)(api.read)

    def path(
        self,
        settings: Settings | Path,
        *,
        faults: Faults = (),
        seed: int | None = None,
        refused: bool = False,
    ) -> Path:
        """Return the file of a run, which no test may change; make it if it does not exist.

        `refused`: a device refuses the run before it moves, which also leaves a recording. Raises ConfigError for an
        invalid configuration, and the error of a run that is refused unexpectedly.
        """
        config = api.load(settings, faults=faults, seed=seed)
        key = json.dumps([refused, config.model_dump(mode="json")], sort_keys=True)
        path = self._folder / f"{hashlib.sha256(key.encode()).hexdigest()[:24]}.mcap"
        if path.exists():
            return path
        with path.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # another process may be making it
            if not path.exists():
                _save(config, path, refused)
        return path

    def __call__(
        self,
        settings: Settings | Path,
        *,
        faults: Faults = (),
        seed: int | None = None,
        refused: bool = False,
    ) -> Recording:
        """Return the recording of a run."""
        return self._read(self.path(settings, faults=faults, seed=seed, refused=refused))


def _save(config: api.Config, path: Path, refused: bool) -> None:
    """Run, and leave a complete file or none."""
    begun: list[api.Simulation] = []

    async def main() -> None:
        async with api.simulation(config) as simulation:
            begun.append(simulation)
            await simulation.finished()

    try:
        api.run_virtual(main)
    except api.BridgeError:
        if not refused or not begun:
            raise
    unfinished = path.with_suffix(".unfinished")
    begun[0].result.save(unfinished, overwrite=True)
    os.replace(unfinished, path)
