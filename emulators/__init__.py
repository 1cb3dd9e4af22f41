"""Emulated devices: synchronous models of physics and behaviour.

The caller passes the time, and the models act only on their wires.
"""
