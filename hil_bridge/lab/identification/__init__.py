"""Identification of a real cell from a recording, as values with uncertainty and as a configuration.

It uses only data received by the client: never the truth of an emulated cell, its settings or its faults.
"""
