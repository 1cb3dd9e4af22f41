"""Fidelity of emulated devices: the inputs of a recording are replayed to the emulator, and the outputs are
compared.
"""
