"""Program of a run: a sequence of legs, checked together and then carried out one after the other. Pure."""
