"""Clients that other people wrote, each in an environment and a process of its own: see `tools.client_environments`.

A test asks `client_python` for the interpreter of an environment that has the package. Where the package cannot be had,
the test is skipped and says so.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from tools.client_environments import ClientMissing, interpreter


@pytest.fixture(scope="session")
def client_python() -> Callable[..., Path]:
    """`interpreter`, for a test."""

    def python_with(*requirements: str) -> Path:
        try:
            return interpreter(*requirements)
        except ClientMissing as error:
            pytest.skip(str(error))

    return python_with
