"""Identification of a tool: mass and centre of gravity from readings in several orientations."""
