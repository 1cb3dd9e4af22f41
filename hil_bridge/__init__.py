"""Force control of a position-controlled robot over its real wires, or over the same wires emulated."""
