"""Commands of `hil-bridge` about many runs, found by entry point."""
