"""A toy load cell that knows hil-bridge by its seams alone."""
