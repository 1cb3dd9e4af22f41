"""Course of a run, from the approach to the lifted tool, and the supervisor that checks it."""
