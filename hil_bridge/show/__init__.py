"""Runs shown to an operator: reports, pages in a browser, the live view in a terminal."""
