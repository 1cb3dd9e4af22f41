"""Configuration of a run: one TOML file, validated as a unit."""
