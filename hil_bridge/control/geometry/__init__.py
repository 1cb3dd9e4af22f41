"""Geometry: frames, rotations, paths and the wrist."""
