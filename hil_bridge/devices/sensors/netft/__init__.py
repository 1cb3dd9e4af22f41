"""ATI Net F/T: its wire, its page, its settings."""
