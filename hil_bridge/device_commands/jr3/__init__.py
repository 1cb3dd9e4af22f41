"""Commands for the JR3: `decode jr3-can` and `decode jr3-uart`, and the monitor of its CAN bus."""
