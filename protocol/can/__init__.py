"""CAN: frames, error frames, bit timing, and the text protocol of slcan adapters."""
