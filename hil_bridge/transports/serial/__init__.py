"""Serial wires: ports, pseudo-terminals, RFC 2217, and the emulated line for wires in memory and for emulated
devices.
"""
