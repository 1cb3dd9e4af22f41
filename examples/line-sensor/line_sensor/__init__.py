"""A force sensor on a serial line that knows hil-bridge by its seams alone."""
