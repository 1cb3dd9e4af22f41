"""Control laws, which convert a force error to a change of depth."""
