"""Checks of a site before its first run: computer, links and sensor."""
