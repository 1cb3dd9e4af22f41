"""Kinds of surfaces of our own beside the one of `[cell.surface]`."""
