"""Small complete implementations, as another person would write them; each can be given a mistake by its name."""
