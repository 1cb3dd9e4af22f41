"""Toy arm that uses only hil-bridge's public interfaces."""
