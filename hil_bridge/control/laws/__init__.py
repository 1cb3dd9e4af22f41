"""Control laws: from a force error to a step of depth."""
