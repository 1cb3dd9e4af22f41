"""CAN: frames, error frames, the times of bits, and the text of slcan adapters."""
