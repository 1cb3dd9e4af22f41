"""Presentation of runs: reports, browser pages and the live terminal view."""
