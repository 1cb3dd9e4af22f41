"""Runs: the composition of devices, the cycle of a run, its ways out, and its replay."""
