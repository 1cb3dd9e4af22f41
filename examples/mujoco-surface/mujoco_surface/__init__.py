"""A surface whose contact MuJoCo computes."""
