"""Commands for individual devices. They are found by entry point; the core imports none of them."""
