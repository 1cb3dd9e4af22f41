"""Judges of clients in any language, by what an emulated device saw and made of them."""
