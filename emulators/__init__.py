"""The devices: physics and behaviour, synchronous, told the time, telling it back only through their wires."""
