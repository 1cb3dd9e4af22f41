"""Kinds of steps, each with its settings, its behaviour in a run, its description and its drawing; and the paths."""
