"""The kinds of steps: each one with its settings, its part in a run, its words and its picture; and the paths."""
