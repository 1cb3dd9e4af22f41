"""The terminal: rows and screens on it, and bugs told on it."""
