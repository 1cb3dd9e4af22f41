"""Identification of a real cell from a recording, as values with uncertainty and as a configuration.

Identification uses only data that the client received: never the truth of an emulated cell, its settings or its
faults.
"""
