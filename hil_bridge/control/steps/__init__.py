"""The words of a program as settings: steps, and the paths that they follow."""
