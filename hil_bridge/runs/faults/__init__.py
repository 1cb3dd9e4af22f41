"""Faults of a run: their configuration, and the schedule that injects them."""
