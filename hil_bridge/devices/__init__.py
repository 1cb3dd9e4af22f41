"""Robots and sensors for a run: interfaces, kinds, facts, and one package per device."""
