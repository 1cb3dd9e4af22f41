"""ABB robots with Externally Guided Motion."""
