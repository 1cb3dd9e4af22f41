"""Settings for every test: the time of an example on a busy machine says nothing about the code.

Examples are the same in every run, so that a run that fails fails again; `--hypothesis-profile explore` draws others.
"""

import pytest
from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile("repeatable")

STREAMS = (
    "tests/clients/",
    "test_egm_live",
    "test_rtde_live",
    "test_bench_live",
    "test_clock_live",
    "devices_of_today",
)
"""Parts of the names of the tests in real time that need a processor for themselves every few milliseconds."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let no two of these run at a time; beside each only one that waits for a slow line."""
    for item in items:
        if item.get_closest_marker("live") is None:
            continue
        if any(part in item.nodeid for part in STREAMS):
            item.add_marker(pytest.mark.xdist_group("streams"))
        else:
            item.add_marker(pytest.mark.xdist_group(item.nodeid.partition("::")[0]))
