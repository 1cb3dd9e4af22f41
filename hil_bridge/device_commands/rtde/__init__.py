"""Commands for Universal Robots controllers: `force-source`."""
