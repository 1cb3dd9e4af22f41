"""The course of a run: task, limits and supervisor around a control law."""
