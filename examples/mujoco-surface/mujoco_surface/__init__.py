"""Surface whose contact MuJoCo computes."""
