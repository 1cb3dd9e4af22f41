"""Words for the faults of a sensor's signal: those of every force/torque sensor, whatever its wire."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from protocol.wrench import AXES

ALL = "all"
"""Every axis."""

_AXIS = Parameter("fz", "which axis", choices=(*AXES, ALL))


def _amount(default: float, meaning: str) -> Parameter:
    return Parameter(default, meaning, -10000.0, 10000.0, "N or N·m")


SIGNAL_FAULTS: Mapping[str, Fault] = {
    "stuck": Fault("every sample repeats the first one, noise included", {}, FOREVER),
    "replayed": Fault(
        "the samples of the first moments come again and again, noise included",
        {"length_s": Parameter(1.0, "how long they are", 0.001, 60.0, "s")},
        FOREVER,
    ),
    "dead": Fault("an axis gives noise only", {"axis": _AXIS}, FOREVER),
    "scale": Fault(
        "an axis is told too small or too large",
        {"axis": _AXIS, "factor": Parameter(0.1, "of what it should be", -100.0, 100.0)},
        FOREVER,
    ),
    "offset": Fault("an axis is off", {"axis": _AXIS, "amount": _amount(20.0, "by how much")}, FOREVER),
    "drift": Fault(
        "an axis goes astray",
        {"axis": _AXIS, "per_s": Parameter(1.0, "how fast", -1000.0, 1000.0, "N/s or N·m/s")},
        FOREVER,
    ),
    "sign": Fault("an axis counts the other way", {"axis": _AXIS}, FOREVER),
    "swapped": Fault(
        "two axes are exchanged",
        {
            "axis": Parameter("fz", "one axis", choices=AXES),
            "other": Parameter("fx", "the other", choices=AXES),
        },
        FOREVER,
        distinct=("axis", "other"),
    ),
    "turned": Fault(
        "force and moment are turned about the sensor's z axis",
        {"degrees": Parameter(90.0, "by how much", -180.0, 180.0, "°")},
        FOREVER,
    ),
    "noise": Fault(
        "the noise is larger", {"factor": Parameter(30.0, "of what it was", 0.0, 10000.0)}, FOREVER
    ),
    "spike": Fault("a peak on an axis", {"axis": _AXIS, "amount": _amount(60.0, "how high")}, 0.005),
    "intermittent": Fault(
        "a loose contact: an axis gives noise only, then the signal, in turn",
        {
            "axis": _AXIS,
            "period_s": Parameter(0.5, "from one loss to the next", 0.001, 3600.0, "s"),
            "duty": Parameter(0.5, "part of the period with signal", 0.0, 1.0),
        },
        FOREVER,
    ),
}
"""Faults by name: the target `signal` of a device. `MeasuredWrench.signal` carries them out."""

WRONG_SCALES: Mapping[str, Fault] = {
    "wrong-scales": Fault(
        "the device tells wrong full scales",
        {
            "factor": Parameter(0.5, "of what they are", 0.0, 100.0),
            "of": Parameter("all", "which", choices=("all", "forces", "moments")),
        },
        FOREVER,
    )
}
"""Of a device that tells its scales."""
