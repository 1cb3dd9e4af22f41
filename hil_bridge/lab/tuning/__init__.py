"""Optimisation of a controller's parameters for a given cell and criterion, with SciPy."""
