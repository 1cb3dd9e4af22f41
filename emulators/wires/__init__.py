"""Emulated adapters between two kinds of wires."""
