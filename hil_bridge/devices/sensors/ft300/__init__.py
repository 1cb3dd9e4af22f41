"""Robotiq FT 300 sensors."""
