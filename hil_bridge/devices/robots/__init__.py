"""The robots: one room per kind."""
