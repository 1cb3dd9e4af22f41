"""Robots and sensors as a run sees them: seams, kinds, facts, and a room for each device."""
