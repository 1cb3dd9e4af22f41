"""Built-in kinds of surfaces in addition to the one of `[cell.surface]`."""
