"""Force sensors: one package per kind, and the stream of frames of a run."""
