"""Batches of runs: campaigns, tuning, identification, conformance tests, experiments of the paper, and the process
pool.
"""
