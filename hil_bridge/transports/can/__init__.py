"""CAN wires: SocketCAN, slcan and python-can, and a bus in memory."""
