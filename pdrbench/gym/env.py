"""The environment: one walk after another, one estimate per observation."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from time import perf_counter
from types import MappingProxyType
from typing import Any, Final, SupportsFloat, cast

import gymnasium
import numpy as np
from numpy.typing import NDArray

from pdrbench.episode import Episode
from pdrbench.errors import EstimateError, PdrbenchError, unknown_name
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.gym.spaces import (
    NOW,
    count_key,
    make_action_space,
    make_observation_space,
    to_action,
    to_observation,
    to_rows,
)
from pdrbench.gym.walks import LEVEL_PENALTY_M, LOCALIZER_NAME, WalkOrder, chosen_walk, is_small, pad, target_of
from pdrbench.localizer import Briefing, Estimate, Localizer
from pdrbench.registry import make_kept_task
from pdrbench.result import Result
from pdrbench.task import HELD_OUT, Task

OPAQUE_SPLITS: Final = ("test", HELD_OUT)
RESULT_KEY: Final = "result"
RENDER_MODES: Final = ("human", "rgb_array")
BLOCK: Final = 512  # observations padded at once: two megabytes of a phone's inertial sensors
ArrayMaker = Callable[[], FloatArray]


class LocalizationEnv(gymnasium.Env[dict[str, Any], NDArray[Any]]):
    """Replays walks of a task.

    The action of a step answers the observation handed out before it: `x_m, y_m, level` (rounded to the nearest
    level), then one value per claim, `converged` from 0.5 on. NaN in any of the first three is no answer; the estimate
    before it, or the start, stands in for it. The reward is minus the distance to the reference in metres, and minus
    15 m per level; 0.0 on a test split. An episode ends with the recording: the observation that comes with the end
    has no rows, and its info holds `result`, the answers without the truth. Before, `info["result"]` is
    what was answered until then, for whatever truncates an episode.

    `reset(seed=...)` shuffles the walks of the split; each further `reset()` goes on to the next one.
    `reset(options={"walk": id_or_index})` plays one walk without moving that order on.

    Attributes:
        task: What is played.
        split: Its walks in play.
        claims: What actions carry beyond the position.
        debug: Set to a localizer's `debug` to have its particles in the picture.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 5}  # noqa: RUF012  as the base class

    def __init__(
        self, task: str | Task, split: str | None = None, claims: Sequence[str] = (), render_mode: str | None = None
    ) -> None:
        """Makes the environment; walks are loaded one by one on reset.

        Args:
            task: Registered id or the task itself.
            split: Walks to play: "train", "val" or "test"; "train" where None, or the first split that there is.
            claims: "heading", "sigma" and "converged" as far as actions carry them, in their order.
            render_mode: "human", "rgb_array" or None.
        """
        self.task = make_kept_task(task) if isinstance(task, str) else task
        self.split = split or self.task.default_split
        self.claims = claims if isinstance(claims, str) else tuple(claims)
        self.debug: Callable[[], Mapping[str, NDArray[Any]]] | None = None
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / self.task.period_s))}
        self.observation_space = make_observation_space(self.task)
        self.action_space = make_action_space(self.claims)
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise unknown_name("render mode", str(render_mode), RENDER_MODES)
        self.render_mode = render_mode
        self._walks = self.task.split(self.split)
        self._order: WalkOrder | None = None
        self._action_shape = (3 + len(self.claims),)
        self._episode: Episode | None = None
        self._observations: Iterator[dict[str, FloatArray]] = iter(())
        self._target: list[list[float]] | None = None
        self._held: tuple[float, float, float] = (0.0, 0.0, 0.0)
        self._answers: list[list[float]] = []
        self._waits_s: list[float] = []
        self._handed_out_s = 0.0
        self._num_left = 0
        self._renderer: Any = None
        self._window: Any = None
        self._can_show = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, FloatArray], dict[str, Any]]:
        """Begins a walk; `info["briefing"]` is what a localizer is given."""
        super().reset(seed=seed)
        if seed is not None or self._order is None:
            self._order = WalkOrder(self._walks, self.np_random)
        walk = chosen_walk(options, self._walks, f"{self.task.id} {self.split}") or self._order.next()
        episode = Episode(self.task.load(walk), self.task)
        self._begin(episode)
        observation = next(self._observations)
        if self.render_mode == "human":
            self.render()
        self._handed_out_s = perf_counter()
        return observation, {"briefing": episode.briefing}

    def _begin(self, episode: Episode) -> None:
        if self._episode is None or self._episode.briefing.building is not episode.briefing.building:
            self._renderer = None
        self._episode = episode
        self._observations = _observations(episode)
        target = target_of(episode, self.split)
        self._target = None if target is None else target.tolist()
        self._held = (*episode.fallback.xy_m.tolist(), episode.fallback.level)
        self._answers, self._waits_s = [], []
        self._num_left = len(episode)

    def step(self, action: FloatArray) -> tuple[dict[str, FloatArray], SupportsFloat, bool, bool, dict[str, Any]]:
        """Answers the last observation and gets the next."""
        taken_s = perf_counter()
        if not self._num_left:
            raise gymnasium.error.ResetNeeded("no walk is being played: call reset() before step(), and after its end")
        given = np.asarray(action, dtype=np.float64)
        if given.shape != self._action_shape:
            raise EstimateError(
                f"an action of this environment has shape {self._action_shape} "
                f"({', '.join(('x_m', 'y_m', 'level', *self.claims))}); got {given.shape}"
            )
        answer = given.tolist()
        reward = 0.0 if self._target is None else self._reward(answer, self._target[len(self._answers)])
        self._answers.append(answer)
        self._waits_s.append(taken_s - self._handed_out_s)
        self._num_left -= 1
        terminated = self._num_left == 0
        observation = next(self._observations)
        info = StepInfo(result=self.result()) if terminated else StepInfo()
        info.played = self, self._episode, self._answers, self._waits_s, len(self._answers)
        if self.render_mode == "human":
            self.render()
        self._handed_out_s = perf_counter()
        return observation, reward, terminated, False, info

    def _reward(self, answer: list[float], target: list[float]) -> float:
        isfinite = math.isfinite
        if isfinite(answer[0]) and isfinite(answer[1]) and isfinite(answer[2]):
            self._held = answer[0], answer[1], round(answer[2])
        x_m, y_m, level = self._held
        target_x_m, target_y_m, target_level = target
        dx_m, dy_m = x_m - target_x_m, y_m - target_y_m
        return -(math.sqrt(dx_m * dx_m + dy_m * dy_m) + LEVEL_PENALTY_M * abs(level - target_level))

    def result(self) -> Result:
        """What was answered so far, without the truth; where the walk goes on, its provenance says that it does."""
        return self.result_of(self._playing(), self._answers, self._waits_s)

    def result_of(self, played: Episode, answers: Sequence[Sequence[float]], waits_s: Sequence[float]) -> Result:
        """The same of answers (N, 3 + claims) to a walk and the N waits for them."""
        episode = played.fresh()
        episode.submit_rows(to_rows(np.array(answers).reshape(-1, *self._action_shape), self.claims))
        provenance = {"truncated": True} if len(answers) < len(played) else {}
        return episode.result(localizer=LOCALIZER_NAME, seed=0, step_s=np.array(waits_s), provenance=provenance)

    @property
    def walk(self) -> str | None:
        """Id of the walk that is played; None before the first, and where walks are opaque."""
        return None if self._episode is None or self.split in OPAQUE_SPLITS else self._episode.recording.id

    @property
    def target(self) -> FloatArray | None:
        """(K, 3) x_m, y_m, level that the answers of this walk are rewarded against; None where none is rewarded."""
        return target_of(self._playing(), self.split)

    @property
    def position(self) -> tuple[float, float, int]:
        """The last answer, `x_m, y_m, level`; before the first, what stands in for it."""
        given = (answer for answer in reversed(self._answers) if all(map(math.isfinite, answer[:3])))
        if (last := next(given, None)) is not None:
            return last[0], last[1], round(last[2])
        fallback = self._playing().fallback
        return float(fallback.xy_m[0]), float(fallback.xy_m[1]), fallback.level

    def _playing(self) -> Episode:
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("no walk is being played: call reset() first")
        return self._episode

    def render(self) -> NDArray[np.uint8] | None:
        """The floor plan of the level, the estimates so far and the last one; no reference.

        Where there is no display, "human" warns once and shows nothing.
        """
        if self.render_mode is None or self._episode is None or not self._can_show:
            return None
        from pdrbench import picture

        if self._renderer is None:
            self._renderer = picture.Renderer(self._episode.briefing.building)
        answers = np.array(self._answers).reshape(-1, *self._action_shape)
        particles = {} if self.debug is None else self.debug()
        frame = draw(self._renderer, self._episode, answers, self.claims, particles)
        if self.render_mode == "rgb_array":
            return frame
        try:
            self._window = self._window or picture.Window()
            self._window.show(frame)
        except PdrbenchError as error:
            warnings.warn(f"the walk goes on unseen: {error}", stacklevel=2)
            self._can_show = False
        return None

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None


class StepInfo(dict[str, Any]):
    """The info of a step; "result" is there at the end of the walk, and made when it is asked for before.

    Whatever truncates an episode, such as `TimeLimit`, has its result so.
    """

    __slots__ = ("played",)
    played: tuple[LocalizationEnv, Any, list[list[float]], list[float], int]  # walk, answers, waits, how many then

    def __missing__(self, key: str) -> Result:
        """What had been answered then, also when the environment has gone on."""
        if key != RESULT_KEY:
            raise KeyError(key)
        env, episode, answers, waits_s, count = self.played
        result = self[key] = env.result_of(episode, answers[:count], waits_s[:count])
        return result

    def __reduce__(self) -> tuple[type, tuple[dict[str, Any]]]:
        """A plain dict in another process, which has no environment to ask."""
        return dict, (dict(self),)


def _observations(episode: Episode) -> Iterator[dict[str, FloatArray]]:
    """What each step hands out, and once more for the end; every array new and its own."""
    copy = np.ndarray.copy
    blank = dict.fromkeys(sorted([NOW, *episode.rows, *map(count_key, episode.rows)]), np.zeros(0))
    for first in range(0, len(episode) + 1, BLOCK):
        last = min(first + BLOCK, len(episode) + 1)
        sources, makers = _block(episode, first, last)
        for step in range(last - first):
            observation = blank.copy()  # a dict that need not grow
            for key, arrays in sources:
                observation[key] = copy(arrays[step])
            for key, calls in makers:
                observation[key] = calls[step]()
            yield observation


def _block(
    episode: Episode, first: int, last: int
) -> tuple[list[tuple[str, list[FloatArray]]], list[tuple[str, list[ArrayMaker]]]]:
    """Observations `first` to `last`, padded ahead: by key the arrays to copy, and what makes the large ones."""
    sources: dict[str, list[FloatArray]] = {NOW: list(episode.now_s[first:last, None])}
    makers: dict[str, list[ArrayMaker]] = {}
    for name, capacity in episode.task.capacity.items():
        rows, ends = episode.rows[name], episode.ends[name][first : last + 1]
        count = np.diff(ends)
        sources[count_key(name)] = list(count[:, None].astype(np.float64))
        if is_small(capacity, rows.shape[1]):
            padded = np.zeros((last - first, capacity, rows.shape[1]))
            pad(rows, ends[:-1], count, out=padded)
            sources[name] = list(padded)
        else:
            makers[name] = _makers(rows, ends, capacity)
    return sorted(sources.items()), sorted(makers.items())


def _makers(rows: FloatArray, ends: IntArray, capacity: int) -> list[ArrayMaker]:
    shape = capacity, rows.shape[1]
    empty = partial(np.zeros, shape)
    return [
        empty if first == last else partial(_filled, shape, last - first, rows[first:last])
        for first, last in itertools.pairwise(ends.tolist())
    ]


def _filled(shape: tuple[int, int], count: int, rows: FloatArray) -> FloatArray:
    frame = np.zeros(shape)
    frame[:count] = rows
    return frame


def draw(
    renderer: Any,
    episode: Episode,
    answers: FloatArray,
    claims: Sequence[str],
    debug: Mapping[str, NDArray[Any]] = MappingProxyType({}),
) -> NDArray[np.uint8]:
    """A frame of a `pdrbench.picture.Renderer` after `answers` (N, 3 + claims) to the first N observations.

    Of the arrays that a localizer offers, `particles_xy_m` (M, 2) and `particles_level` (M,) are shown.
    """
    given = answers[np.isfinite(answers[:, :3]).all(axis=1)]
    level = episode.fallback.level
    estimate = None
    if len(given):
        last = given[-1]
        level = round(float(last[2]))
        claimed = dict(zip(claims, last[3:].tolist(), strict=True))
        heading_rad, sigma_m = (
            None if math.isnan(v) else v for v in (claimed.get(k, math.nan) for k in ("heading", "sigma"))
        )
        estimate = Estimate(xy_m=last[:2], level=level, heading_rad=heading_rad, sigma_m=sigma_m)
    return cast(
        NDArray[np.uint8],
        renderer.frame(
            level,
            given[:, :2],
            estimate,
            debug.get("particles_xy_m"),
            debug.get("particles_level"),
            now_s=float(episode.now_s[len(answers)]),
            trail_level=np.rint(given[:, 2]),
        ),
    )


def drive(
    localizer: Localizer,
    env: gymnasium.Env[dict[str, Any], NDArray[Any]],
    rng: np.random.Generator,
    *,
    seed: int | None = None,
    options: Mapping[str, Any] | None = None,
) -> Result:
    """Plays one walk of an environment with a localizer, by `env.reset` and `env.step` alone.

    Make the environment with `claims=("heading", "sigma", "converged")` to have them scored too.

    Args:
        localizer: Anything with `reset` and `step`; what it raises is not caught, and `revise` is not asked for.
        env: A `LocalizationEnv`, possibly within wrappers that leave its spaces alone.
        rng: The localizer's own randomness.
        seed: For `env.reset`.
        options: For `env.reset`.
    """
    inner = cast(LocalizationEnv, env.unwrapped)
    inner.debug = None
    arrays, info = env.reset(seed=seed, options=None if options is None else dict(options))
    briefing: Briefing = info["briefing"]
    localizer.reset(briefing, rng)
    inner.debug = getattr(localizer, "debug", None)
    terminated = truncated = False
    while not (terminated or truncated):
        answer = localizer.step(to_observation(arrays, briefing.sensors))
        arrays, _, terminated, truncated, info = env.step(to_action(answer, inner.claims))
    result: Result = info[RESULT_KEY]
    return result
