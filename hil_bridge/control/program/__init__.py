"""A program of a run: steps that a person writes, checked as a whole and then taken one after the other. Pure."""
