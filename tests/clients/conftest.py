"""Third-party clients, each in a separate environment and process: see `tools.client_environments`.

A test asks `client_python` for the interpreter of an environment with the package. If the package is not available, the
test is skipped with a message.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from tools.client_environments import ClientMissing, interpreter


@pytest.fixture(scope="session")
def client_python() -> Callable[..., Path]:
    """Return `interpreter` for a test."""

    def python_with(*requirements: str) -> Path:
        try:
            return interpreter(*requirements)
        except ClientMissing as error:
            pytest.skip(str(error))

    return python_with
