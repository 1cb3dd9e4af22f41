"""Wire formats: bytes and CAN frames ↔ meaning, as state machines without I/O.

Standard library only; nothing here asks for the time, it is told.
"""
