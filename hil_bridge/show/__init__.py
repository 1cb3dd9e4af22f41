"""Runs shown to a person: reports, pages in a browser, the live view in a terminal."""
