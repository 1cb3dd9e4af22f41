"""The general half of emulated sensors: samples of the true wrench, noise, reading ahead, and faults of the signal."""

from emulators.sensing.measured import Converter, MeasuredWrench
from emulators.sensing.samples import KnownWrench, NoisyWrench, NumberedNoise, Samples

__all__ = ["Converter", "KnownWrench", "MeasuredWrench", "NoisyWrench", "NumberedNoise", "Samples"]
