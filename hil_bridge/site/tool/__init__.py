"""Measuring a tool: its mass and centre from readings in several orientations."""
