"""Contact force of an emulated surface at the depths of a recording, compared with the measured force.

The depth of a recording has an arbitrary origin. The depth at which the tip touches the surface is the only fitted
parameter.
"""

import math

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from emulators.seams import Surface
from emulators.surface.contact import Contact
from emulators.surface.profile import SurfaceProfile
from hil_bridge.devices.kinds import SURFACES
from hil_bridge.errors import ConfigError
from hil_bridge.lab.fidelity import measures
from hil_bridge.lab.fidelity.comparing import Law
from hil_bridge.lab.fidelity.measures import LEAST_SAMPLES, Floats
from hil_bridge.lab.fidelity.tables import Table
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.kinds import surface_settings

_RATE_HZ = 8000
"""Lowest sample rate for a surface with memory, Hz. Source: `emulators.seams.Surface`."""
_TRIED = 61
"""Number of touch depths that are tried before the refinement. Chosen."""
_FORCES_N = (1.0, 3.0, 5.0, 7.0, 9.0)
"""Forces at which the stiffness is reported, N. Chosen."""
_LAW_SHARE = 0.05
"""Share of the largest force above which the power law is fitted. Chosen: clear of the noise."""
_BEFORE_MOST = 2.0
"""Largest distance from the touch to the smallest depth, as a multiple of the span of depths. Chosen."""


def emulate_contact(config: Config, table: Table) -> Table:
    """Compute the force of a configured surface at the depths of a table. Raises ConfigError."""
    if not (table.has("depth") and table.has("press")):
        raise ConfigError("the recording has no contact; map depth and press")
    surface, profile = _surface_of(config)
    depth, press = table.columns["depth"], table.columns["press"]
    low, high = float(depth.min()), float(depth.max())

    def cost(touch: float) -> float:
        return measures.rms(_vertical_force(surface, profile, table.times, depth - touch) - press)

    tried = np.linspace(low - (high - low), high, _TRIED)  # a recording may begin in contact
    best = int(np.argmin([cost(float(touch)) for touch in tried]))
    bounds = tried[max(best - 1, 0)], tried[min(best + 1, _TRIED - 1)]
    touch = float(minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-8}).x)
    return Table(
        table.times,
        {"depth": depth - touch, "press": _vertical_force(surface, profile, table.times, depth - touch)},
    )


def _surface_of(config: Config) -> tuple[Surface, SurfaceProfile]:
    """Return the surface of a configuration, and the profile with its position. Raises ConfigError."""
    name = config.cell.surface_kind
    try:
        if not name:
            return Contact(config.cell.surface), config.cell.surface
        kind = SURFACES.kind(name)
        settings = surface_settings(config, kind)
        surface = kind.make(settings)(lambda changed_at: None)
    except ValueError as error:
        raise ConfigError(f"{f'cell.{name}' if name else 'cell.surface'}: {error}") from error
    return surface, settings if isinstance(settings, SurfaceProfile) else config.cell.surface


def _vertical_force(surface: Surface, profile: SurfaceProfile, times: Floats, depth: Floats) -> Floats:
    """Return the vertical force at these depths of the tip below the surface, N."""
    fine = times
    if surface.remembered_until is not None:
        fine = np.arange(times[0], times[-1], 1.0 / _RATE_HZ)
    height = profile.height_mm / 1e3
    origin = profile.origin_x_mm / 1e3, profile.origin_y_mm / 1e3
    below = np.interp(fine, times, depth)
    positions = np.column_stack([np.full(len(fine), part) for part in origin] + [height - below])
    velocities = np.column_stack([np.zeros((len(fine), 2)), -np.gradient(below, fine)])
    force = surface.aside().force(positions, velocities, fine)[:, 2]
    pressed: Floats = np.interp(times, fine, force)
    return pressed


def laws_of(measured: Table, emulated: Table) -> tuple[Law, ...]:
    """Fit force = a · depth^n to both tables, where a, n and the touch depth are free.

    Returns n, and the stiffness of the law at several forces.
    """
    fits = [fit_law(table) for table in (measured, emulated)]
    laws = [Law("exponent of the depth", "", *(exponent for exponent, _ in fits))]
    laws += [
        Law(
            f"stiffness of the law at {force:g} N",
            "N/m",
            *(
                exponent * scale ** (1.0 / exponent) * force ** (1.0 - 1.0 / exponent)
                for exponent, scale in fits
            ),
        )
        for force in _FORCES_N
        if force <= float(measured.columns["press"].max())
    ]
    return tuple(law for law in laws if not (math.isnan(law.measured) and math.isnan(law.emulated)))


def fit_law(table: Table) -> tuple[float, float]:
    """Fit force = a · depth^n. Return the exponent n and the scale a, N/m^n; both are NaN if they cannot be
    determined.
    """
    depth, press = table.columns["depth"], table.columns["press"]
    most = float(press.max())
    inside = press > _LAW_SHARE * most
    if not most > 0.0 or inside.sum() < LEAST_SAMPLES // 2 or not np.ptp(depth[inside]):
        return math.nan, math.nan
    depth, press = depth[inside] - float(depth[inside].min()), press[inside] / most
    span = float(np.ptp(depth))
    depth = depth / span

    def rest(law: Floats) -> Floats:
        before, exponent, scale = law
        left: Floats = scale * (depth + before) ** exponent - press
        return left

    fit = least_squares(rest, (0.1, 1.0, 1.0), bounds=((1e-6, 0.2, 1e-6), (_BEFORE_MOST, 5.0, 1e3)))
    _, exponent, scale = map(float, fit.x)
    return (exponent, scale * most / span**exponent) if fit.success else (math.nan, math.nan)
