"""Analysis after a run: figures of merit, stability, the tool that hangs below the sensor."""
