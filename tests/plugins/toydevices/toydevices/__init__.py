"""Three toys that know hil-bridge by its seams alone."""
