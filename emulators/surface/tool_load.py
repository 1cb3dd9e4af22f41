"""Load of surface and obstacles on the tool, for the motion of its tip or of every point of its face."""

import math
from typing import Any

import numpy as np

from emulators.seams import ArmPath, Floats, Surface
from emulators.spindle import Spindle
from emulators.surface.face import ContactLoad, Face, join_loads, turn_rates
from emulators.surface.faults import Obstacles
from emulators.tool import rotation_matrix

_UP = np.array([0.0, 0.0, 1.0])
"""Unit vector of base z."""
_PAST_S = 10.0
"""Longest missed motion that a surface with memory receives later, s: the duration that an arm's path keeps."""
_SPREAD_AT_ONCE = 128
"""Number of samples of a face that are computed at once. Chosen: larger arrays do not stay in a processor's cache."""
_TURN_S = 0.02
"""Averaging window of a tool's turn rate, s. Chosen: several ticks, because the tool does not turn within a tick."""
MEMORY_RATE_HZ = 8000
"""Lowest sample rate at which a surface with memory is evaluated, Hz. Chosen: the sample rate of our sensor."""


class InvalidForce(Exception):
    """The surface of a plug-in returned an invalid force.

    `blamed` holds the surface and the name of the failing method.
    """

    def __init__(self, surface: Surface, positions: Floats, force: object) -> None:
        if isinstance(force, np.ndarray) and force.shape == positions.shape:
            row = int(np.argmin(np.isfinite(force.astype(float)).all(axis=1)))
            text = f"the surface returned {force[row].tolist()} N for a tip at {positions[row].round(6).tolist()} m"
        else:
            got = f"shape {force.shape}" if isinstance(force, np.ndarray) else type(force).__name__
            text = f"the surface returned {got} for {len(positions)} positions; expected: shape {positions.shape}"
        super().__init__(text)
        self.blamed = surface, "force"


class ToolLoad:
    """Load on the tool of a cell. The surface is an argument, so that a copy of it can be tried."""

    def __init__(
        self, path: ArmPath, powered_at: float, face: Face | None, obstacles: Obstacles, is_plugin: bool
    ) -> None:
        """`powered_at` is the time from which a surface with memory receives the motion of the tool, s. The results of
        a plug-in are checked.
        """
        self.path = path
        """Path of the tool."""
        self.spindle: Spindle | None = None
        """Spindle that turns the tool; None for a tool that does not turn."""
        self._powered_at, self._face, self._obstacles = powered_at, face, obstacles
        self._is_plugin = is_plugin

    def at(self, surface: Surface, times: Floats, count: bool = True) -> ContactLoad:
        """Return force and moment of surface and obstacles on the tool at `times` (n,) in ascending order, s.

        With `count`, the obstacles count this contact as an effect of their fault.
        """
        return self.of_motion(surface, times, self.path.trajectory(times), count)

    def of_motion(
        self, surface: Surface, times: Floats, motion: tuple[Floats, Floats], count: bool = True
    ) -> ContactLoad:
        """Return force and moment of surface and obstacles on the tool for its positions and velocities (n, 3).

        A surface with memory first receives the samples since power-up that were never read, so its force depends
        on the motion and not on the reads. If the missed motion is too long, the force is computed as if the tip
        had jumped to its position.
        """
        if (remembered := surface.remembered_until) is not None:
            begin = max(remembered, times[0] - _PAST_S, self._powered_at) * MEMORY_RATE_HZ
            # A margin of one millionth prevents rounding from changing a sample number.
            missed = np.arange(math.floor(begin + 1e-6) + 1, math.ceil(times[0] * MEMORY_RATE_HZ - 1e-6))
            if len(missed):
                past = missed / MEMORY_RATE_HZ
                self._surface_load(surface, past, *self._with_run_out(past, self.path.trajectory(past)))
        positions, velocities = self._with_run_out(times, motion)
        force, moment = self._surface_load(surface, times, positions, velocities)
        if self._obstacles.any:
            force = force + np.outer(self._obstacles.force(positions[:, 2], times, count), _UP)
        return ContactLoad(force, moment)

    def _with_run_out(self, times: Floats, motion: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        """Return positions and velocities (n, 3) including the run-out of the spindle."""
        if self.spindle is None:
            return motion
        offset, drift = self.spindle.run_out(times, self.path.orientations(times))
        return motion[0] + offset, motion[1] + drift

    def _surface_load(
        self, surface: Surface, times: Floats, positions: Floats, velocities: Floats
    ) -> ContactLoad:
        """Return force and moment of the surface, excluding obstacles.

        `positions` and `velocities` (n, 3) are those of the tool centre point.
        """
        if self._face is None:
            return ContactLoad(self._surface_force(surface, positions, velocities, times), None)
        parts = []
        for begin in range(0, len(times), _SPREAD_AT_ONCE):
            part = slice(begin, begin + _SPREAD_AT_ONCE)
            orientations = self.path.orientations(times[part])
            before = self.path.orientations(times[part] - _TURN_S)
            turning = turn_rates(orientations, before, _TURN_S)
            if self.spindle is not None:
                spin = self.spindle.turning(orientations)
                turning = spin if turning is None else turning + spin
            points = self._face.spread(
                positions[part], velocities[part], orientations, rotation_matrix, turning
            )
            times_of_points = np.repeat(times[part], self._face.count)
            forces = self._surface_force(surface, points.positions, points.velocities, times_of_points)
            parts.append(self._face.gather(forces, points.arms))
        return join_loads(parts)

    def _surface_force(
        self, surface: Surface, positions: Floats, velocities: Floats, times: Floats
    ) -> Floats:
        """Return the forces of the surface at these points.

        Raises InvalidForce if a plug-in returns an invalid result.
        """
        force: Any = surface.force(positions, velocities, times)
        if self._is_plugin and not (
            isinstance(force, np.ndarray) and force.shape == positions.shape and np.isfinite(force).all()
        ):
            raise InvalidForce(surface, positions, force)
        forces: Floats = force
        return forces
