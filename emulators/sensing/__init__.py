"""Device-independent part of emulated sensors: samples of the true wrench, noise, prediction and signal faults."""

from emulators.sensing.measured import Converter, MeasuredWrench
from emulators.sensing.samples import KnownWrench, NoisyWrench, NumberedNoise, Samples, SteppedWrench

__all__ = [
    "Converter",
    "KnownWrench",
    "MeasuredWrench",
    "NoisyWrench",
    "NumberedNoise",
    "Samples",
    "SteppedWrench",
]
