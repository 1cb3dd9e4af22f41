"""The configuration: one TOML file, validated as a whole."""
