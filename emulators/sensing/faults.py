"""Definitions of the faults of a sensor's signal, shared by all force/torque sensors."""

from collections.abc import Mapping

from emulators.faults.kinds import FOREVER, Fault, Parameter
from protocol.wrench import AXES

ALL = "all"
"""Value that selects all axes."""

_AXIS = Parameter("fz", "affected axis", choices=(*AXES, ALL))


def _amount(default: float, meaning: str) -> Parameter:
    return Parameter(default, meaning, -10000.0, 10000.0, "N or N·m")


SIGNAL_FAULTS: Mapping[str, Fault] = {
    "stuck": Fault("every sample repeats the first one, including its noise", {}, FOREVER),
    "replayed": Fault(
        "the samples of the first moments repeat again and again, including their noise",
        {"length_s": Parameter(1.0, "duration of the repeated samples", 0.001, 60.0, "s")},
        FOREVER,
    ),
    "dead": Fault("an axis reports noise only", {"axis": _AXIS}, FOREVER),
    "scale": Fault(
        "the signal of an axis is too small or too large",
        {"axis": _AXIS, "factor": Parameter(0.1, "factor on the true value", -100.0, 100.0)},
        FOREVER,
    ),
    "offset": Fault(
        "an axis has an additional offset", {"axis": _AXIS, "amount": _amount(20.0, "offset")}, FOREVER
    ),
    "drift": Fault(
        "an axis drifts",
        {"axis": _AXIS, "per_s": Parameter(1.0, "rate of the drift", -1000.0, 1000.0, "N/s or N·m/s")},
        FOREVER,
    ),
    "sign": Fault("an axis has the wrong sign", {"axis": _AXIS}, FOREVER),
    "swapped": Fault(
        "two axes are swapped",
        {
            "axis": Parameter("fz", "first axis", choices=AXES),
            "other": Parameter("fx", "second axis", choices=AXES),
        },
        FOREVER,
        distinct=("axis", "other"),
    ),
    "turned": Fault(
        "force and moment are turned about the sensor's z axis",
        {"degrees": Parameter(90.0, "angle", -180.0, 180.0, "°")},
        FOREVER,
    ),
    "noise": Fault(
        "the noise is larger", {"factor": Parameter(30.0, "factor on the noise", 0.0, 10000.0)}, FOREVER
    ),
    "spike": Fault("a peak on an axis", {"axis": _AXIS, "amount": _amount(60.0, "height")}, 0.005),
    "intermittent": Fault(
        "a loose contact: an axis alternates between noise only and the signal",
        {
            "axis": _AXIS,
            "period_s": Parameter(0.5, "period", 0.001, 3600.0, "s"),
            "duty": Parameter(0.5, "share of the period with signal", 0.0, 1.0),
        },
        FOREVER,
    ),
}
"""Faults of the target `signal` of a device, by name. `MeasuredWrench.signal` carries them out."""

WRONG_SCALES: Mapping[str, Fault] = {
    "wrong-scales": Fault(
        "the device reports wrong full scales",
        {
            "factor": Parameter(0.5, "factor on the true full scales", 0.0, 100.0),
            "of": Parameter("all", "affected full scales", choices=("all", "forces", "moments")),
        },
        FOREVER,
    )
}
"""Faults of a device that reports its own full scales."""
