"""The room of the JR3 sensors."""
