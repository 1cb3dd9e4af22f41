"""Force sensor on a serial line, which uses only hil-bridge's public interfaces."""
