"""Questions to the guard: its conditions as a table, and what it would do with an observation."""
