"""Judges of robot clients in any language, by what an emulated robot saw of them."""
