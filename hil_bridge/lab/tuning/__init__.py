"""A controller's parameters for a given cell and criterion, by an optimiser of SciPy's."""
