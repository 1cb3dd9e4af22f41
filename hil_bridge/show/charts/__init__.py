"""The catalogue of a run's charts: facts, columns, descriptions, marks. Pages and pictures draw what it describes."""
