"""Built-in kinds of surfaces, in addition to the surface of `[cell.surface]`."""
