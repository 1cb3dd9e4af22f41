"""Commands for controllers of Universal Robots: `force-source`."""
