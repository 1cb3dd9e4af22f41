"""Conformance of robot clients: scenarios, evidence and verdicts."""
