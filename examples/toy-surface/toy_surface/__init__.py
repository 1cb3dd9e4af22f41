"""Toy surface that uses only hil-bridge's public interfaces."""
