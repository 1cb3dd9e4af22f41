"""UFACTORY xArm robots and the force sensor at their wrist: wire, clients and emulated control box."""
