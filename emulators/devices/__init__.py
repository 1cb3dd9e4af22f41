"""The emulated devices, one folder for each."""
