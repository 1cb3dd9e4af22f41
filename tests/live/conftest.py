"""The begin that several of these tests share."""

from pathlib import Path

import pytest

from tests.live.processes import NEAR

TOOL = "[tool]\nmass_kg = 0.5\ncentre_of_gravity_mm = [0.0, 0.0, 80.0]\n"
"""The emulated cell's tool."""


@pytest.fixture
def near(tmp_path: Path) -> str:
    """A configuration that begins near the surface and retracts by little, and knows the emulated cell's tool."""
    path = tmp_path / "c.toml"
    path.write_text(NEAR + TOOL)
    return str(path)
