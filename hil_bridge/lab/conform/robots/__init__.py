"""Clients of robots: the scenarios, the evidence and the verdict."""
