"""Environment: follow a surface with a target force, using the bridge and its emulated devices.

An episode is a run in virtual time. It begins at the first contact, and ends with the run. Every byte between bridge
and devices is the same as with real devices, and the guard checks each action. The guard cannot be disabled; its
limits are settings.
"""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypedDict, Unpack

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from hil_bridge.control.laws.policy import AXES, HIGH, LOW, Axis, Observed, PolicyController
from hil_bridge.control.laws.thinking import Thinking
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.gym.beginnings import Beginnings
from hil_bridge.gym.drawing import Episodes, Tables, plan_episodes
from hil_bridge.gym.episode import (
    Choice,
    Decision,
    Episode,
    EpisodeEnd,
    EpisodeSettings,
    ThreadEpisode,
)
from hil_bridge.gym.rendering import Picture
from hil_bridge.gym.rewards import Reward, Transition, make_reward
from hil_bridge.gym.snapshots import SUPPORTED, Snapshots
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.given import Source
from protocol.marks import SettingError

SENSORS: Mapping[str, str] = {"s3": "jr3"}
"""Default sensor kind for each robot kind; all other robots use `netft`."""
_USUAL_SENSOR = "netft"
SKIPPED_MAX = 50
"""Maximum number of consecutive runs that end before their first contact. Chosen: after more, the settings must be
wrong.
"""
BEGINNINGS = 16
"""Default number of different beginnings of episodes. Chosen: 16 snapshots of a streaming robot take half a gigabyte
and up to a minute of processor time, and their draws spread over the range of each setting.
"""
_NONE_YET = {"episodes": 0, "stops": 0, "skipped": 0}


class Options(TypedDict, total=False):
    """Further arguments of the environment."""

    config: Source
    """Base configuration, overridden by the other arguments: a file, tables, or a `Config`. `run.duration_s` ends an
    episode."""
    actions: tuple[Axis, ...]
    """Axes of the action, from `AXES`; default `("along",)`."""
    speed_mm_s: float
    """Speed of the setpoint for an action of 1, mm/s; default 5."""
    turn_deg_s: float
    """Angular speed of the tool for an action of 1, °/s; default 5."""
    reward: str | Reward
    """Name of a reward, or a function of a `Transition`; default `"force-error"`."""
    randomise: Mapping[str, Any]
    """Ranges and lists by configuration key, as in [campaign.draw], drawn for each episode."""
    faults: Tables
    """Faults from which each episode draws, as in the tables [[campaign.fault]]."""
    faults_per_run: int | Mapping[str, int]
    """Number of faults per episode, or its range such as `{"from": 0, "to": 2}`; default 1 if `faults` is set."""
    beginnings: int
    """Number of different beginnings of episodes, each with its own seed and drawn settings; default 16. 0 lets every
    episode be new."""
    thinking_ms: Thinking
    """Time from an observation until its action takes effect, ms; see `PolicyController`. Default 0."""
    truth: bool
    """Whether `info` contains the true position and force of the tool; default False, because it takes a tenth of the
    time of a step."""
    render_mode: str | None
    """`"rgb_array"` for pictures by `render()`; default None."""
    keep: Path | str
    """Folder for the recordings of stopped runs; by default they are not saved."""


class FollowEnv(gymnasium.Env[Observed, NDArray[np.float32]]):
    """Gymnasium environment `hil-bridge/Follow-v0`.

    A run that ends before the tool touches the surface does not become an episode. It is counted in
    `info["skipped"]`, and the next seed is used.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  the class of Gymnasium declares it so

    def __init__(
        self,
        robot: str = "s3",
        sensor: str | None = None,
        surface: Mapping[str, Any] | str | None = None,
        **options: Unpack[Options],
    ) -> None:
        """Create the environment. `robot` and `sensor` are kinds of emulated devices. `surface` contains settings
        of [cell.surface], or is the kind of a surface. Raises ConfigError for an invalid setting.
        """
        if unknown := set(options) - set(Options.__annotations__):
            known = ", ".join(Options.__annotations__)
            raise ConfigError(f"the environment has no argument {min(unknown)!r}; known: {known}")
        over: dict[str, object] = {
            "robot.emulated": robot,
            "sensor.emulated": sensor or SENSORS.get(robot, _USUAL_SENSOR),
        }
        if isinstance(surface, str):
            over["cell.surface_kind"] = surface
        else:
            over |= {f"cell.surface.{key}": value for key, value in (surface or {}).items()}
        self._episodes: Episodes = plan_episodes(
            options.get("config"),
            over,
            options.get("randomise", {}),
            options.get("faults", ()),
            options.get("faults_per_run"),
        )
        self._axes = tuple(options.get("actions", AXES[:1]))
        self._speeds = options.get("speed_mm_s", 5.0), options.get("turn_deg_s", 5.0)
        thinking = options.get("thinking_ms", 0.0)
        self._thinking = dict(thinking) if isinstance(thinking, Mapping) else thinking
        try:
            PolicyController(lambda observed: observed, self._axes, *self._speeds, thinking_ms=self._thinking)
        except SettingError as error:
            raise ConfigError(str(error)) from error
        reward = options.get("reward", "force-error")
        self._reward: Reward = make_reward(reward) if isinstance(reward, str) else reward
        keep = options.get("keep")
        self._keep = None if keep is None else Path(keep).absolute()
        count = options.get("beginnings", BEGINNINGS)
        if type(count) is not int or count < 0:
            raise ConfigError(f"beginnings must be an integer from 0, got {count!r}")
        self._beginnings = Beginnings(count)
        self._snapshots = Snapshots(count) if count and SUPPORTED else None
        self.render_mode = options.get("render_mode")
        if self.render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigError(f'render_mode must be "rgb_array" or None, got {self.render_mode!r}')
        self._picture = None if self.render_mode is None else Picture()
        self._truth = options.get("truth", False) or self._picture is not None
        self.observation_space = spaces.Box(LOW, HIGH, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (len(self._axes),), np.float32)
        self._episode: Episode | None = None
        self._decision: Decision | None = None
        self._seed = 0
        self._answered_at = 0.0
        self._counts = dict(_NONE_YET)

    def config(self, seed: int) -> Config:
        """Return the configuration of the episode with this `info["seed"]`, for `hil_bridge.simulate`.

        Raises ConfigError if the drawn settings contradict each other.
        """
        return self._episodes.config(seed)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observed, dict[str, Any]]:
        """Begin an episode. An episode that is still running is abandoned.

        `seed` determines all following episodes, and resets the counts. `options={"episode": N}` sets the
        `info["seed"]` of this episode to N. Raises ConfigError if no run reaches a contact.
        """
        super().reset(seed=seed)
        if seed is not None:
            self._counts = dict(_NONE_YET)
            self._beginnings.clear()
        self._leave()
        chosen = (options or {}).get("episode")
        text = ""
        for _ in range(SKIPPED_MAX):
            self._seed = self._beginnings.draw(self.np_random) if chosen is None else int(chosen)
            begun = self._begin()
            if isinstance(begun, Decision):
                return self._begun(begun, chosen is None)
            self._counts["skipped"] += 1
            text = begun.text or "it ended before it touched the surface"
            if chosen is not None:
                break
        raise ConfigError(f"no run reaches a contact; the last one, with seed {self._seed}: {text}")

    def _begin(self) -> Decision | EpisodeEnd:
        """Begin the episode with the present seed, from its snapshot if the system supports snapshots."""
        settings = EpisodeSettings(
            self._episodes.base,
            self._episodes.drawn(self._seed),
            self._seed,
            self._axes,
            self._speeds,
            self._thinking,
            self._truth,
            self._keep,
        )
        if self._snapshots is not None:
            self._episode, begun = self._snapshots.start(settings)
            return begun
        self._episode = ThreadEpisode(settings)
        return self._episode.start()

    def _begun(self, decision: Decision, is_drawn: bool) -> tuple[Observed, dict[str, Any]]:
        """Return the answer to a reset."""
        if is_drawn:
            self._beginnings.keep(self._seed)
        self._decision = decision
        self._counts["episodes"] += 1
        info = {**self._info(decision), "seed": self._seed, "drawn": self._episodes.drawn_values(self._seed)}
        if self._picture is not None:
            self._picture.begin(self.config(self._seed), decision)
        self._answered_at = time.perf_counter()
        return decision.observation, info

    def step(self, action: NDArray[np.floating[Any]]) -> tuple[Observed, float, bool, bool, dict[str, Any]]:
        """Apply an action and run to the next decision.

        `terminated` means that the run was stopped or has ended, `truncated` that its time is up. The last
        observation of an episode is the observation at its last decision. Raises ResetNeeded if no episode is
        running, and ValueError for an invalid action.
        """
        thought_s = time.perf_counter() - self._answered_at
        episode, before = self._episode, self._decision
        if episode is None or before is None:
            raise gymnasium.error.ResetNeeded("no episode is running; call reset()")
        values = np.array(action, np.float64).reshape(-1)
        if values.shape != self.action_space.shape or not np.isfinite(values).all():
            raise ValueError(f"an action must be {len(self._axes)} numbers from -1 to 1, got {action!r}")
        self._decision = None  # until there is another one
        after = episode.act(Choice(tuple(values.tolist()), thought_s))
        if self._picture is not None:
            self._picture.extend(after)
        if isinstance(after, Decision):
            self._decision = after
            transition = Transition(after.cycles, after.at - before.at, values, None, stopped=False)
            answer = after.observation, float(self._reward(transition)), False, False, self._info(after)
            self._answered_at = time.perf_counter()
            return answer
        return before.observation, *self._end(before, after, values)

    def _end(
        self, before: Decision, end: EpisodeEnd, action: NDArray[np.float64]
    ) -> tuple[float, bool, bool, dict[str, Any]]:
        """Return reward, terminated, truncated and info of the last step of an episode."""
        result, stopped = end.result, end.stopped
        self._counts["stops"] += stopped
        transition = Transition(end.cycles, 0.0, action, result, stopped)
        if cycles := transition.at_work:
            over = next(
                (c.started_at for c in end.cycles if c.cycle > cycles[-1].cycle), cycles[-1].answered_at
            )
            transition = transition._replace(seconds=max(over - before.at, 0.0))
        time_is_up = result is not None and not stopped and _is_time(result.cause)
        info = {
            **self._info(before),
            "outcome": "refused" if result is None else str(result.outcome),
            "cause": "" if result is None or result.cause is None else str(result.cause),
            "text": end.text,
        }
        return float(self._reward(transition)), not time_is_up, time_is_up, info

    def _info(self, decision: Decision) -> dict[str, Any]:
        """Return the counts of this environment, and the true state of the cell at a decision if there is one."""
        if decision.truth is None:
            return dict(self._counts)
        position, force = map(np.array, decision.truth)
        return {"truth_position": position, "truth_force": force, **self._counts}

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the present state, shape (height, width, 3); None without `render_mode`."""
        if self._picture is None:
            return None
        if not self._picture.has_begun:
            raise gymnasium.error.ResetNeeded("there is no episode to render; call reset()")
        return self._picture.draw()

    def _leave(self) -> None:
        """Abandon the running episode."""
        episode, self._episode, self._decision = self._episode, None, None
        if episode is not None:
            episode.leave()

    def close(self) -> None:
        """End the running episode and the processes of this environment. Idempotent."""
        self._leave()
        if self._snapshots is not None:
            self._snapshots.close()

    def __del__(self) -> None:
        if hasattr(self, "_counts"):  # the last attribute of a complete environment
            self.close()


def _is_time(cause: Cause | None) -> bool:
    """Return whether a run ended because its time limit or its distance limit was reached."""
    return cause in (Cause.TIME_IS_UP, Cause.TRAVELLED)
