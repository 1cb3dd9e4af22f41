"""Commands of `hil-bridge` for batches of runs, loaded by entry point."""
