"""Results computed from a recording: summary, cycle times, latencies."""
