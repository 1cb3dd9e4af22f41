"""Clients of force sensors: the scenarios, the evidence and the verdict."""
