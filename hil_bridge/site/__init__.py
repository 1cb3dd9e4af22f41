"""Checks of a site before its first run: the computer, the wires and the sensor."""
