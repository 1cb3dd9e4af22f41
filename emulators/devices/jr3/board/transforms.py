"""Transforms and full scales as matrices.

A wrench is a column (6,) of force and moment in N and N·m.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from protocol.devices.jr3 import FULL_SCALE_COUNTS
from protocol.devices.jr3.board import TURN_COUNTS, Link, LinkType, UnitScales, VectorAxes

Floats = NDArray[np.float64]

_SMALLEST = 0.004
"""Smallest allowed min_full_scale; the board's data is wrong below it. Source: JR3 manual 5907E."""
_REPRESENTABLE = 2.0
"""Range of full scales that fit a word."""
_HALF_RANGE = 32768
_LARGEST = 32767


def _cross(arm: Floats) -> Floats:
    x, y, z = arm
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _rotation(axis: int, angle: float) -> Floats:
    """Return the matrix of a right-handed rotation about an axis."""
    turned = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned[i, i] = turned[j, j] = math.cos(angle)
    turned[i, j], turned[j, i] = -math.sin(angle), math.sin(angle)
    return turned


def _link_matrix(link: Link, length: float, turns: float) -> Floats:
    matrix = np.eye(6)
    match link.type:
        case LinkType.NEGATE:
            return -matrix if link.amount else matrix
        case LinkType.ROTATE_X | LinkType.ROTATE_Y | LinkType.ROTATE_Z:
            angle = turns * math.pi * link.amount / TURN_COUNTS
            matrix[:3, :3] = matrix[3:, 3:] = _rotation(link.type - LinkType.ROTATE_X, angle)
        case _:
            arm = np.zeros(3)
            arm[link.type - LinkType.TRANSLATE_X] = link.amount * length
            # The force acts at the old origin, which lies at −arm from the new one.
            matrix[3:, :3] = -_cross(arm)
    return matrix


def transform_matrix(links: Sequence[Link], length: float, turns_load: bool) -> Floats:
    """Return the matrix that converts a wrench at the sensor's origin to the frame defined by the links.

    Each link starts from the frame of the previous ones (assumed). `length` is one unit of a translation, m. A
    positive rotation turns the load in the right-handed sense, or else it turns the frame.
    """
    matrix = np.eye(6)
    for link in links:
        matrix = _link_matrix(link, length, 1.0 if turns_load else -1.0) @ matrix
    return matrix


@dataclass(frozen=True)
class Scaling:
    """Conversion of raw channels to counts of full scale."""

    calibration: Floats
    """Calibration matrix (6, 6): wrench in N and N·m = raw @ calibration."""
    adc_bits: int
    units: UnitScales
    turns_load: bool
    full_scales: tuple[int, ...]
    """Full scales in use, six words."""
    links: tuple[Link, ...] = ()
    span: float = 16.0
    """Largest ratio of max_full_scale to min_full_scale. With 16 it has no effect."""

    @cached_property
    def _unit(self) -> Floats:
        """Size of one unit of each full-scale word, N or N·m."""
        return np.array([self.units.force] * 3 + [self.units.moment] * 3)

    @cached_property
    def _wrench_per_raw(self) -> Floats:
        matrix = transform_matrix(self.links, self.units.length, self.turns_load)
        return matrix @ self.calibration.T

    @cached_property
    def counts_per_raw(self) -> Floats:
        """Counts per raw unit (6 axes, 6 channels)."""
        counts: Floats = FULL_SCALE_COUNTS / (np.array(self.full_scales) * self._unit)
        return counts[:, np.newaxis] * self._wrench_per_raw

    @cached_property
    def recommended(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Recommended min_full_scale and max_full_scale, as words.

        Assumed: min_full_scale holds the sum of all channels at their limits. With max_full_scale, one step of the
        converter on the strongest channel is one count; it is at most `span` times min_full_scale.
        """
        part = np.abs(self._wrench_per_raw) / self._unit[:, np.newaxis]
        smallest = part.sum(axis=1) * _HALF_RANGE / _REPRESENTABLE
        largest = part.max(axis=1) * _HALF_RANGE / _REPRESENTABLE * (1 << (16 - self.adc_bits))
        # Rounded first, so that an error in the last digit does not change an integer to the next one.
        low, high = np.ceil(np.round(smallest, 6)), np.floor(np.round(largest, 6))
        high = np.minimum(high, np.floor(self.span * low))
        return tuple(map(_word, low)), tuple(map(_word, high))

    @cached_property
    def too_small(self) -> NDArray[np.bool_]:
        """Axes whose full scale is so small that the board's numbers overflow (6,)."""
        smallest: NDArray[np.bool_] = np.array(self.full_scales) < _SMALLEST * np.array(self.recommended[0])
        return smallest

    def offsets_in(self, other: "Scaling", offsets: Sequence[int]) -> list[int]:
        """Return the offsets, converted to the frame and full scales of another scaling.

        Source: the manual, for transforms.
        """
        # Both scalings decouple the same channels, so the raw reading is the same for both.
        raw = np.linalg.solve(self.counts_per_raw, np.array(offsets, np.float64))
        converted = np.clip(np.rint(other.counts_per_raw @ raw), -_HALF_RANGE, _LARGEST)
        return [int(value) for value in converted]


def vectors(axes: VectorAxes, full_scales: Sequence[int]) -> tuple[Floats, tuple[int, int]]:
    """Return the weights and the full scales of the two vectors.

    A vector's squared counts are the weighted sum of the axes' squared counts; the weights are (2, 6).
    """
    chosen = np.zeros((2, 6), bool)
    for row, (shift, of_moments) in enumerate(
        ((0, VectorAxes.V1_OF_MOMENTS in axes), (3, VectorAxes.V2_OF_FORCES not in axes))
    ):
        for axis in range(3):
            chosen[row, 3 * of_moments + axis] = bool(axes >> shift + axis & 1)
    scales = np.where(chosen, np.array(full_scales, np.float64), 0.0)
    largest = scales.max(axis=1)
    weights = np.square(scales / np.maximum(largest, 1.0)[:, np.newaxis])
    return weights, (int(largest[0]), int(largest[1]))


def _word(value: float) -> int:
    return int(min(max(value, 1), _LARGEST))
