"""Emulated adapters between wires."""
