"""From site to desk: what a recording of a real cell shows, as values with their uncertainty and as a configuration.

It uses only what the client of a recording saw: never the truth of an emulated cell, its settings or its faults.
"""
