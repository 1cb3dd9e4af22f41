"""Toy load cell that uses only hil-bridge's public interfaces."""
