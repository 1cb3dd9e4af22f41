"""Step that presses a peg into a hole, and a plate with a hole to try it on."""
