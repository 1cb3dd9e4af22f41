"""The faults of a run: what a configuration says of them, and the schedule that injects them."""
