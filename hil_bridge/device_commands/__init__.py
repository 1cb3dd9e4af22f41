"""Commands of single devices, found by entry point: the core imports none of them."""
