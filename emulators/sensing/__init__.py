"""The general half of emulated sensors: samples of the true wrench, noise, and reading ahead."""

from emulators.sensing.samples import KnownWrench, NoisyWrench, NumberedNoise, Samples

__all__ = ["KnownWrench", "NoisyWrench", "NumberedNoise", "Samples"]
