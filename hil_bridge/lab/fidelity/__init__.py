"""How far an emulated device is from a measured one: a recording's inputs are played to the emulator, and compared."""
