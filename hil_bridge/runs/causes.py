"""Causes of an end, and exceptions of any kind, in words."""

import traceback

from hil_bridge.control import one_line


def kind_of(cause: str) -> str:
    """A cause without what is known of it besides, which is another every time."""
    return cause.partition(";")[0]


def told(error: Exception) -> str:
    """The first line of what an exception says, whatever it is."""
    try:
        return one_line(str(error))
    except Exception as second:
        return f"<{type(second).__name__}>"


def traceback_of(error: Exception) -> str:
    try:
        return "".join(traceback.format_exception(error))
    except Exception as second:  # an exception that cannot be shown
        return f"{type(error).__name__}, which cannot be shown: {type(second).__name__}"
