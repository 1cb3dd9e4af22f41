"""Robotiq FT 300."""
