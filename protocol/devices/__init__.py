"""Device protocols, one package for each device."""
