"""Conformance tests of clients in any language, judged by what the emulated device received."""
