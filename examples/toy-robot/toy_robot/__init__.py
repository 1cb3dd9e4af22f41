"""A toy arm that knows hil-bridge by its seams alone."""
