"""Table of docs/reference/gym.md: each quantity of an observation."""

from hil_bridge.gym import OBSERVED
from tools.pages import table


def observation_table() -> str:
    """Return the table of all quantities in order."""
    rows = ((f"`{one.name}`", f"{one.low:g} … {one.high:g}", one.meaning) for one in OBSERVED)
    return table(("name", "range", "meaning"), rows)


TABLES = {"observation": observation_table}
