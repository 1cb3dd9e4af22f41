"""The bridge's room for an ATI Net F/T: its wire, its page, its settings."""
