"""The bridge's room for a Robotiq FT 300."""
