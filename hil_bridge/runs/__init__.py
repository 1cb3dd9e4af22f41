"""Runs: composition of devices, cycle of a run, end of a run, and replay."""
