"""Frames, rotations and the wrist."""
