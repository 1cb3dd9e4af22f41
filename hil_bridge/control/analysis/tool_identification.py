"""Identification of the tool's mass, centre of gravity and sensor bias from readings in several orientations. Pure.

Let u be the weight of one kilogram in the tool frame, with all axes along the tool's axes at the sensor's origin.
Then force = m u + bias, moment = (m c) × u + bias. Both are linear in m, m c and the biases, so each is one linear
least squares problem. Source: textbook rigid-body statics.

Rotating the tool about the vertical does not change u. With only two directions of u, the component of c along
their difference stays undetermined, so u has to change in two directions.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hil_bridge.control.geometry.frames import GRAVITY_BASE, STANDARD_GRAVITY, Array, rotation_matrix
from hil_bridge.control.geometry.wrist import NO_WRENCH, Wrist
from hil_bridge.errors import ConfigError
from protocol.geometry import Vector

POSES_MIN = 3
"""Minimum number of poses. Derived: u changes in two directions only with at least three directions of the weight."""

SPREAD_MIN = 0.12
"""Minimum spread of the weight's direction (a unit vector) in its second direction, as a root mean square about the
mean.

Chosen: the spread of five poses that turn the tool by 11° to either side about two axes. Its centre of gravity is
three times less accurate than with 35° to either side.
"""

_RANGE_N = 1.0
"""Minimum range of an axis over the poses at which its residuals can verify it, N. Chosen: the usual tolerance of
the weight.
"""
_FOLLOWS_SHARE = 0.1
"""Largest residuals of a verified axis, as a share of its range. Chosen: the residuals of a sensor mounted 6° off."""
_ADVICE = "turn the tool by 60° or more about two horizontal axes"
_SIGNIFICANT = 5.0
"""Smallest mass for which a centre of gravity is estimated, in standard uncertainties of the mass. Chosen."""


@dataclass(frozen=True, slots=True)
class ToolPose:
    """One orientation of the tool in free space, with the sensor's reading."""

    quaternion: tuple[float, ...]
    """Orientation of the tool in the base frame, w x y z."""
    wrench: tuple[float, ...]
    """Mean reading in the sensor frame, N and N·m, shape (6,). The sensor is not zeroed between poses."""
    scatter: tuple[float, ...] = NO_WRENCH
    """Standard deviation of single readings about their mean, N and N·m, shape (6,); zeros if unknown."""


@dataclass(frozen=True, slots=True)
class ToolEstimate:
    """Estimated mass, centre of gravity and bias of the tool below the sensor, each with its standard uncertainty."""

    mass: float
    """Mass, kg."""
    mass_uncertainty: float
    """Standard uncertainty of the mass, kg."""
    centre_of_gravity: Vector
    """Centre of gravity relative to the sensor's origin, along the axes of the tool frame, m."""
    centre_of_gravity_uncertainty: Vector
    """Standard uncertainty of each component of the centre of gravity, m."""
    bias: tuple[float, ...]
    """Reading of the sensor without load, in the sensor frame, N and N·m, shape (6,)."""
    bias_uncertainty: tuple[float, ...]
    """Standard uncertainty of the bias, N and N·m, shape (6,)."""
    residuals: tuple[tuple[float, ...], ...]
    """Difference between reading and estimate for each pose, in the sensor frame, N and N·m, shape (n, 6)."""
    turned: float
    """Largest angle between two directions of the weight in the tool frame, rad."""
    swings: tuple[float, ...]
    """Range of each force axis over the poses, in the sensor frame, N, shape (3,)."""

    @property
    def force_residual(self) -> float:
        """Root mean square of the force residuals, N."""
        return _rms(np.array(self.residuals)[:, :3])

    @property
    def moment_residual(self) -> float:
        """Root mean square of the moment residuals, N·m."""
        return _rms(np.array(self.residuals)[:, 3:])

    @property
    def verified(self) -> tuple[int, ...]:
        """Indices of the force axes that followed the rotating weight, and so work with the right sign and scale."""
        rest = np.array(self.residuals)
        return tuple(
            k
            for k, force_range in enumerate(self.swings)
            if force_range >= _RANGE_N and _rms(rest[:, k]) <= _FOLLOWS_SHARE * force_range
        )


def identify_tool(poses: Sequence[ToolPose], wrist: Wrist) -> ToolEstimate:
    """Return the tool that explains the readings best. Only the orientation and handedness of `wrist` are used.

    Uncertainties are based on the variance of the residuals or the variance of the readings, whichever is larger. A
    filter makes successive readings dependent, so several of them count as one. Raises ConfigError if the poses are
    not sufficient, with what is missing.
    """
    if len(poses) < POSES_MIN:
        raise ConfigError(
            f"too few poses to identify the tool: {len(poses)} of at least {POSES_MIN}; {_ADVICE}"
        )
    readings = np.array([pose.wrench for pose in poses], dtype=float)
    if not np.all(np.isfinite(readings)):
        raise ConfigError("a reading of the sensor is not a number; measure that pose again or leave it out")
    weights = np.array([rotation_matrix(pose.quaternion).T @ GRAVITY_BASE for pose in poses])
    turned = _require_spread(weights / STANDARD_GRAVITY)

    to_sensor = wrist.alignment().T
    each, here = len(poses), np.eye(3)
    bias = np.tile(here, (each, 1))
    forces = np.hstack([np.concatenate(weights @ to_sensor.T)[:, None], bias])
    moments = np.hstack([np.vstack([-to_sensor @ _cross(weight) for weight in weights]), bias])
    noise = np.array([pose.scatter for pose in poses], dtype=float)
    (mass, *force_bias), force_covariance, force_rest = _fit(forces, readings[:, :3], noise[:, :3])
    solution, moment_covariance, moment_rest = _fit(moments, readings[:, 3:], noise[:, 3:])
    first_moment, moment_bias = solution[:3], solution[3:]

    mass_variance = float(force_covariance[0, 0])
    if not mass > _SIGNIFICANT * math.sqrt(mass_variance):
        raise ConfigError(
            f"the weight does not follow the turning of the tool: {mass:.3f} kg ± {math.sqrt(mass_variance):.3f} kg; "
            "the tool is too light for this sensor, touches something, or sensor.mounting_deg or flip_fx_mx is wrong"
        )
    centre = first_moment / mass
    centre_variance = (np.diag(moment_covariance)[:3] + centre**2 * mass_variance) / mass**2
    variances = np.concatenate([np.diag(force_covariance)[1:], np.diag(moment_covariance)[3:]])
    return ToolEstimate(
        mass=float(mass),
        mass_uncertainty=math.sqrt(mass_variance),
        centre_of_gravity=_vector(centre),
        centre_of_gravity_uncertainty=_vector(np.sqrt(centre_variance)),
        bias=(*map(float, force_bias), *moment_bias.tolist()),
        bias_uncertainty=tuple(np.sqrt(variances).tolist()),
        residuals=tuple(map(tuple, np.hstack([force_rest, moment_rest]).tolist())),
        turned=turned,
        swings=tuple(np.ptp(readings[:, :3], axis=0).tolist()),
    )


def _require_spread(directions: Array) -> float:
    """Return the largest angle between unit vectors of shape (n, 3), rad.

    Raises ConfigError if they change in too few directions.
    """
    turned = max(
        math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))
        for a in directions
        for b in directions
    )
    spread = np.linalg.svd(directions - directions.mean(axis=0), compute_uv=False) / math.sqrt(
        len(directions)
    )
    if spread[0] < SPREAD_MIN:
        raise ConfigError(
            f"the poses differ by {math.degrees(turned):.0f}° at most in the direction of gravity; {_ADVICE}"
        )
    if spread[1] < SPREAD_MIN:
        raise ConfigError(
            f"the poses turn the tool by up to {math.degrees(turned):.0f}° about one axis, and hardly about another; "
            f"{_ADVICE}"
        )
    return turned


def _fit(design: Array, readings: Array, noise: Array) -> tuple[Array, Array, Array]:
    """Return the least squares solution of shape (k,), its covariance of shape (k, k), and the residuals of shape
    (n, 3).
    """
    solution = np.asarray(np.linalg.lstsq(design, readings.ravel(), rcond=None)[0], dtype=np.float64)
    rest = readings.ravel() - design @ solution
    degrees_of_freedom = len(rest) - len(solution)
    variance = max(float(rest @ rest) / degrees_of_freedom, float(np.mean(noise**2)))
    covariance = np.asarray(variance * np.linalg.inv(design.T @ design), dtype=np.float64)
    return solution, covariance, readings - (design @ solution).reshape(-1, 3)


def _cross(vector: Array) -> Array:
    """Return the matrix of shape (3, 3) that computes `vector` × …."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
