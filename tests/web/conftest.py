"""What the tests of the page share: a browser, and a run with a page in a process of its own."""

import os
import signal
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import pytest
import pytest_asyncio

from tools.chromium import Page, browser, found
from tools.web_run import WebRun

REQUIRED = "HIL_BRIDGE_REQUIRE_CHROMIUM"


@pytest_asyncio.fixture
async def page() -> AsyncIterator[Page]:
    """A page of a headless Chromium."""
    if found() is None:
        if os.environ.get(REQUIRED):
            pytest.fail(f"{REQUIRED} is set and there is no Chromium")
        pytest.skip("there is no Chromium on this machine")
    async with browser() as page:
        yield page


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
