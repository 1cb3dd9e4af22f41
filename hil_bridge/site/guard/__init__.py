"""Queries to the guard: its conditions as a table, and its decision for an observation."""
