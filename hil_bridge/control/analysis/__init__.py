"""Analysis after a run: figures of merit, stability and identification of the tool below the sensor."""
