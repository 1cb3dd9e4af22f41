"""Robots of Universal Robots over RTDE."""
