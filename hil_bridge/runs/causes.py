"""Causes of an end, in words."""


def kind_of(cause: str) -> str:
    """A cause without what is known of it besides, which is another every time."""
    return cause.partition(";")[0]
