"""The languages of the devices, one folder each."""
