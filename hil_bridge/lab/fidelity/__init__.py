"""Fidelity of emulated devices: the inputs of a recording are replayed to the emulator, and its output is compared."""
