"""An ABB robot with Externally Guided Motion."""
