"""Surface that a tool touches: contact, shapes, materials, wear, and the faults of the surface."""
