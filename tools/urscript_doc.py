"""Tables of docs/reference/urscript.md: each function of URScript, and how far it goes."""

from collections import Counter

from emulators.devices.rtde.urscript import FUNCTIONS
from emulators.devices.rtde.urscript.table import Support
from protocol.devices.rtde.fields import NEVER, Number
from tools.pages import table


def counts() -> str:
    """How many functions are modelled, and how many only have their names."""
    support = Counter(function.support for function in FUNCTIONS.values())
    return f"{support[Support.MODELLED]} functions are modelled, {support[Support.TAGGED]} are tagged."


def function_table() -> str:
    """All functions by name."""
    rows = (
        (
            f"`{function.signature}`",
            function.support,
            "yes" if function.waits else "",
            _version(function.since_cb3),
            _version(function.since),
        )
        for _, function in sorted(FUNCTIONS.items())
    )
    return table(("function", "support", "may wait", "CB3 since", "e-Series since"), rows)


def _version(since: Number) -> str:
    """The first version of a function; empty for one that was always there, or is taken to be."""
    return "never" if since == NEVER else ".".join(map(str, since)) if any(since) else ""


TABLES = {"counts": counts, "functions": function_table}
