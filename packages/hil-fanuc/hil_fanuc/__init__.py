"""FANUC robots with Stream Motion and the Remote Motion Interface, for hil-bridge."""
