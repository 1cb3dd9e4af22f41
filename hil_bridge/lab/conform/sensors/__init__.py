"""Conformance of force sensor clients: scenarios, evidence and verdicts."""
