"""The emulated devices, one folder each."""
