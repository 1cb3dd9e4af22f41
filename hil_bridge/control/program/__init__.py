"""A program of a run: its legs in one row, checked as a whole and then taken one after the other. Pure."""
