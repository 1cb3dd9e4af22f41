"""Fixtures for page tests: a browser, and commands that serve a page in separate processes."""

import os
import signal
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import pytest
import pytest_asyncio

from tools.chromium import Page, browser, found
from tools.web_run import Serving, WebRun

REQUIRED = "HIL_BRIDGE_REQUIRE_CHROMIUM"


@pytest_asyncio.fixture
async def page() -> AsyncIterator[Page]:
    """Provide a page of a headless Chromium."""
    if found() is None:
        if os.environ.get(REQUIRED):
            pytest.fail(f"{REQUIRED} is set and there is no Chromium")
        pytest.skip("there is no Chromium on this machine")
    async with browser() as page:
        yield page


@pytest.fixture
def serving() -> Iterator[list[Serving]]:
    """Provide commands that serve a page; remaining processes are ended."""
    servings: list[Serving] = []
    yield servings
    for one in servings:
        if one.process.poll() is None:
            one.process.send_signal(signal.SIGKILL)
            one.process.wait()


@pytest.fixture
def web_run(tmp_path: Path, serving: list[Serving]) -> Callable[..., WebRun]:
    """Provide a function that starts runs with a page."""

    def start(*arguments: str, config: str = "") -> WebRun:
        folder = tmp_path / str(len(serving))
        folder.mkdir()
        run = WebRun(folder, arguments, config)
        serving.append(run)
        return run

    return start
