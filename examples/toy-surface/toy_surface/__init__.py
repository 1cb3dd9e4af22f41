"""A toy surface that knows hil-bridge by its seams alone."""
