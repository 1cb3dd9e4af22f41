"""Figures summed up from a recording: the summary, the times of a cycle, the latencies of a cell."""
