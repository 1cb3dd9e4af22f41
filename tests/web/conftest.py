"""What the tests of the page share: a browser, and a run with a page in a process of its own."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import pytest
import pytest_asyncio

from tools.chromium import Page, browser, found

REQUIRED = "HIL_BRIDGE_REQUIRE_CHROMIUM"
PATIENCE_S = 60.0


@pytest_asyncio.fixture
async def page() -> AsyncIterator[Page]:
    """A page of a headless Chromium."""
    if found() is None:
        if os.environ.get(REQUIRED):
            pytest.fail(f"{REQUIRED} is set and there is no Chromium")
        pytest.skip("there is no Chromium on this machine")
    async with browser() as page:
        yield page


class WebRun:
    """A run with its page."""

    def __init__(self, folder: Path, arguments: tuple[str, ...], config: str) -> None:
        file = folder / "run.toml"
        file.write_text(config)
        self.log = folder / "run.log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "hil_bridge", "run", str(file), "--web", "--no-view", *arguments],
                cwd=folder,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
        self.url = self._line("page: ")
        self.origin, _, fragment = self.url.partition("/#token=")
        self.token = fragment
        self.port = int(self.origin.rpartition(":")[2])

    def _line(self, begin: str) -> str:
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until and self.process.poll() is None:
            for line in self.log.read_text().splitlines():
                if line.startswith(begin):
                    return line.removeprefix(begin)
            time.sleep(0.05)
        raise AssertionError(f"the run never told {begin!r}: {self.log.read_text()}")

    def server(self) -> int:
        """Process that serves the page."""
        children = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split()
        for child in map(int, children):
            if b"hil_bridge.web" in Path(f"/proc/{child}/cmdline").read_bytes():
                return child
        raise AssertionError("no process serves the page")

    def ended(self) -> int:
        """Exit code, once the run has ended."""
        return self.process.wait(PATIENCE_S)


@pytest.fixture
def web_run(tmp_path: Path) -> Iterator[Callable[..., WebRun]]:
    """Starts runs with a page, and ends what is left of them."""
    runs: list[WebRun] = []

    def start(*arguments: str, config: str = "") -> WebRun:
        folder = tmp_path / str(len(runs))
        folder.mkdir()
        runs.append(WebRun(folder, arguments, config))
        return runs[-1]

    yield start
    for run in runs:
        if run.process.poll() is None:
            run.process.send_signal(signal.SIGKILL)
            run.process.wait()
