"""Small complete implementations, as a third party would write them; each can contain a named mistake."""
