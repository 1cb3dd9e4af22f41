"""Serial wires: ports, pseudo-terminals, RFC 2217, and the line that memory and emulated wires keep to."""
