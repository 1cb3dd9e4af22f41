"""Universal Robots controllers over RTDE."""
