"""The force sensors: one room per kind, and the stream of frames that a run reads."""
