"""JR3 sensors."""
