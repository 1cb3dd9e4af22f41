"""Tables of docs/reference/urscript.md: each function of URScript, and its level of support."""

from collections import Counter

from emulators.devices.rtde.urscript import FUNCTIONS
from emulators.devices.rtde.urscript.table import Support
from protocol.devices.rtde.fields import NEVER, Number
from tools.pages import table


def counts() -> str:
    """Return a sentence with the number of modelled functions and the number of tagged functions."""
    support = Counter(function.support for function in FUNCTIONS.values())
    return f"{support[Support.MODELLED]} functions are modelled, {support[Support.TAGGED]} are tagged."


def function_table() -> str:
    """Return the table of the functions, grouped by support, waiting and first versions."""
    groups = dict[tuple[str, str, str, str], list[str]]()
    for _, function in sorted(FUNCTIONS.items()):
        waits = "yes" if function.waits else ""
        group = str(function.support), waits, _version(function.since_cb3), _version(function.since)
        groups.setdefault(group, []).append(f"`{function.signature}`")
    rows = ((*group, ", ".join(signatures)) for group, signatures in sorted(groups.items()))
    return table(("support", "may wait", "CB3 since", "e-Series since", "functions"), rows)


def _version(since: Number) -> str:
    """Return the first version of a function; empty if it has always existed, or is assumed to have existed."""
    return "never" if since == NEVER else ".".join(map(str, since)) if any(since) else ""


TABLES = {"counts": counts, "functions": function_table}
