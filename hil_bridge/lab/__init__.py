"""Batches of runs: campaigns, tuning, identification, conformance tests, experiments of the paper, process pool."""
