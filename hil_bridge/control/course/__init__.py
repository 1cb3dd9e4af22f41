"""The course of a run: the stroke from the approach to the lifted tool, and the guard around it."""
