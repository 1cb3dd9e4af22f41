"""Clients that other people wrote, unmodified, from the package index: each in an environment and a process of its own.

A test asks `client_python` for the interpreter of an environment that has the package. The environment is made once,
beside the project's own, and kept. Where the package cannot be had, the test is skipped and says so.
"""

import subprocess
import sys
import venv
from collections.abc import Callable
from pathlib import Path

import pytest

ENVIRONMENTS = Path(sys.prefix) / "cache" / "clients"
INSTALL_S = 240


def interpreter(*requirements: str) -> Path:
    """The Python of an environment with these pinned packages, made anew where an earlier try was cut short."""
    place = ENVIRONMENTS / "+".join(requirement.replace("==", "-") for requirement in requirements)
    python, done = place / "bin" / "python", place / "complete"
    if not done.exists():
        venv.create(place, with_pip=True, clear=True)
        try:
            installed = subprocess.run(
                [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *requirements],
                capture_output=True,
                text=True,
                check=False,
                timeout=INSTALL_S,
            )
        except subprocess.TimeoutExpired:
            pytest.skip(f"{', '.join(requirements)} did not come from the package index in {INSTALL_S} s")
        if installed.returncode:
            why = (installed.stderr.strip().splitlines() or ["no reason given"])[-1]
            pytest.skip(f"{', '.join(requirements)} cannot be had from the package index: {why}")
        done.touch()
    return python


@pytest.fixture(scope="session")
def client_python() -> Callable[..., Path]:
    """`interpreter`, for a test."""
    return interpreter
