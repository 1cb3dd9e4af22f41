"""The surface that a tool touches: contact, materials, and their faults."""
