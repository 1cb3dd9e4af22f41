"""Start shared by several of these tests."""

from pathlib import Path

import pytest

from tests.live.processes import NEAR

TOOL = "[tool]\nmass_kg = 0.5\ncentre_of_gravity_mm = [0.0, 0.0, 80.0]\n"
"""Tool of the emulated cell."""


@pytest.fixture
def near(tmp_path: Path) -> str:
    """Return a configuration that starts near the surface, retracts little, and knows the emulated cell's tool."""
    path = tmp_path / "c.toml"
    path.write_text(NEAR + TOOL)
    return str(path)
