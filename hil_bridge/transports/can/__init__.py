"""CAN wires: SocketCAN, slcan, python-can, and a bus in memory."""
