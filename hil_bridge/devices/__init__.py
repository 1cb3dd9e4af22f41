"""Robots and sensors of a run: interfaces, device kinds, facts, and one package per device."""
