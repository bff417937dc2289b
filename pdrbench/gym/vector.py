"""Many walks at once: replay in batches, without a loop over environments in the common step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from pdrbench.episode import Episode
from pdrbench.errors import EstimateError, RecordingError, unknown_name
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.gym.env import draw
from pdrbench.gym.spaces import NOW, count_key, make_action_space, make_observation_space, to_rows
from pdrbench.gym.walks import LEVEL_PENALTY_M, LOCALIZER_NAME, WalkOrder, chosen_walk, is_small, pad, target_of
from pdrbench.registry import make_kept_task
from pdrbench.task import Task

NEXT_STEP: Final = "NextStep"
SAME_STEP: Final = "SameStep"
DISABLED: Final = "Disabled"
AUTORESET_MODES: Final = (NEXT_STEP, SAME_STEP, DISABLED)
RENDER_MODES: Final = ("rgb_array",)
Step = tuple[dict[str, FloatArray], FloatArray, BoolArray, BoolArray, dict[str, Any]]


class LocalizationVectorEnv(VectorEnv[dict[str, FloatArray], FloatArray, NDArray[Any]]):
    """Batched `LocalizationEnv`: the same walks in the same order, observations and rewards as `SyncVectorEnv`.

    Environment i is seeded with `seed + i`. The results in `infos["result"]` carry no timings, since one wait answers
    for the whole batch.
    """

    def __init__(
        self,
        num_envs: int,
        task: str | Task,
        split: str | None = None,
        claims: Sequence[str] = (),
        render_mode: str | None = None,
        autoreset_mode: str | Any = NEXT_STEP,
    ) -> None:
        """Makes the environments; walks are loaded one by one when they begin.

        Args:
            num_envs: How many walks are replayed at once.
            task: As for `LocalizationEnv`.
            split: As for `LocalizationEnv`.
            claims: As for `LocalizationEnv`.
            render_mode: "rgb_array" or None.
            autoreset_mode: "NextStep", "SameStep" or "Disabled", or Gymnasium's `AutoresetMode`.
        """
        super().__init__()
        self._mode = str(getattr(autoreset_mode, "value", autoreset_mode))
        if self._mode not in AUTORESET_MODES:
            raise unknown_name("autoreset mode", self._mode, AUTORESET_MODES)
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise unknown_name("render mode of a vector environment", str(render_mode), RENDER_MODES)
        if num_envs < 1:
            raise RecordingError(f"a vector environment has at least one environment; got num_envs={num_envs}")
        self.task = make_kept_task(task) if isinstance(task, str) else task
        self.split = split or self.task.default_split
        self.claims = tuple(claims)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.metadata = {"render_modes": list(RENDER_MODES), "autoreset_mode": _announced(self._mode)}
        self.single_observation_space = make_observation_space(self.task)
        self.single_action_space = make_action_space(self.claims)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._walks = self.task.split(self.split)
        self._orders: list[WalkOrder | None] = [None] * num_envs
        self._env = np.arange(num_envs)
        self._store = _Store(self.task, num_envs, 3 + len(self.claims))
        self._step = np.zeros(num_envs, dtype=np.int64)
        self._held = np.zeros((num_envs, 3))
        self._ended = np.ones(num_envs, dtype=np.bool_)
        self._has_begun = False
        self._renderers: list[Any] = [None] * num_envs

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, FloatArray], dict[str, Any]]:
        """Begins a walk in every environment, or in those that `options["reset_mask"]` (num_envs,) names."""
        options = dict(options or {})
        mask = self._checked_mask(options.pop("reset_mask", None))
        seeds = self._seeds(seed)
        chosen = chosen_walk(options, self._walks, f"{self.task.id} {self.split}")
        infos: dict[str, Any] = {}
        for env in np.flatnonzero(mask).tolist():
            if seeds[env] is not None or self._orders[env] is None:
                self._orders[env] = WalkOrder(self._walks, seeding.np_random(seeds[env])[0])
            infos = self._begin(env, infos, chosen)
        self._has_begun = True
        return self._store.observe(self._step), infos

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int):
            return [seed + env for env in range(self.num_envs)]
        seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise RecordingError(f"expected one seed per environment, {self.num_envs}; got {len(seeds)}")
        return seeds

    def _checked_mask(self, mask: object) -> BoolArray:
        if mask is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        if not isinstance(mask, np.ndarray) or mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise RecordingError(f"options['reset_mask'] is a bool array of shape ({self.num_envs},); got {mask!r}")
        if not mask.any() or not (self._has_begun or mask.all()):
            raise RecordingError("options['reset_mask'] names at least one environment, and all of them at first")
        return mask

    def _begin(self, env: int, infos: dict[str, Any], walk: str | None = None) -> dict[str, Any]:
        """Puts the next walk, or `walk`, into one environment."""
        order = self._orders[env]
        assert order is not None
        walk = walk or order.next()
        episode = self._store.begun(walk) or Episode(self.task.load(walk), self.task)
        self._store.put(env, episode, target_of(episode, self.split))
        self._step[env] = 0
        self._held[env] = *episode.fallback.xy_m, episode.fallback.level
        self._ended[env] = False
        self._renderers[env] = None
        return self._add_info(infos, {"briefing": episode.briefing}, env)

    def step(self, actions: FloatArray) -> Step:
        """Answers the last observation of every environment and gets the next."""
        actions = np.asarray(actions, dtype=np.float64)
        if actions.shape != self.action_space.shape:
            raise EstimateError(
                f"the actions of this environment have shape {self.action_space.shape} "
                f"({', '.join(('x_m', 'y_m', 'level', *self.claims))}); got {actions.shape}"
            )
        live = ~self._ended
        infos: dict[str, Any] = {}
        if not live.all():
            if not self._has_begun or self._mode == DISABLED:
                raise gymnasium.error.ResetNeeded("a walk has not begun or has ended: call reset() before step()")
            for env in np.flatnonzero(~live).tolist():
                infos = self._begin(env, infos)
        self._store.answers[self._env, self._step] = actions
        rewards = self._rewards(actions, live)
        self._step = self._step + live
        terminations = self._step == self._store.length
        self._ended = terminations.copy()
        observations = self._store.observe(self._step)
        for env in np.flatnonzero(terminations).tolist():
            infos = self._end(env, infos, observations)
        if self._mode == SAME_STEP and terminations.any():
            observations = self._store.observe(self._step)
        return observations, rewards, terminations, np.zeros(self.num_envs, dtype=np.bool_), infos

    def _end(self, env: int, infos: dict[str, Any], observations: Mapping[str, FloatArray]) -> dict[str, Any]:
        """Hands over the result of a walk; where the next one begins at once, so does it here."""
        episode = self._store.episode(env)
        episode.submit_rows(to_rows(self._store.answers[env, : len(episode)], self.claims))
        info = {"result": episode.result(localizer=LOCALIZER_NAME, seed=0)}
        if self._mode != SAME_STEP:
            return self._add_info(infos, info, env)
        final = {key: array[env].copy() for key, array in observations.items()}
        infos = self._add_info(infos, {"final_obs": final, "final_info": info}, env)
        return self._begin(env, infos)

    def _rewards(self, actions: FloatArray, live: BoolArray) -> FloatArray:
        if self.split == "test":
            return np.zeros(self.num_envs)
        given = np.isfinite(actions[:, :3]).all(axis=1) & live
        self._held[given, :2] = actions[given, :2]
        self._held[given, 2] = np.rint(actions[given, 2])
        off = self._held - self._store.target[self._env, self._step]
        off *= self._store.is_rewarded[:, None]
        distance_m = np.sqrt(off[:, 0] * off[:, 0] + off[:, 1] * off[:, 1])
        rewards: FloatArray = -(distance_m + LEVEL_PENALTY_M * np.abs(off[:, 2]))
        rewards[~live] = 0.0
        return rewards

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A frame per environment: floor plan, estimates so far, the last one; no reference."""
        if self.render_mode is None or not self._has_begun:
            return None
        from pdrbench import picture

        frames = []
        for env in range(self.num_envs):
            episode = self._store.episode(env)
            if self._renderers[env] is None:
                self._renderers[env] = picture.Renderer(episode.briefing.building)
            answers = self._store.answers[env, : self._step[env]]
            frames.append(draw(self._renderers[env], episode, answers, self.claims))
        return tuple(frames)


def _announced(mode: str) -> Any:
    """Gymnasium's enum of autoreset modes, which came with 1.1; the plain name before."""
    modes = getattr(gymnasium.vector, "AutoresetMode", None)
    return mode if modes is None else modes(mode)


class _Store:
    """The walks in play, one slot per environment, side by side in arrays that grow with the longest walk."""

    def __init__(self, task: Task, num_envs: int, action_width: int) -> None:
        self._task = task
        self._env = np.arange(num_envs)
        self._keys = sorted([NOW, *task.capacity, *map(count_key, task.capacity)])
        self._episodes: list[Episode | None] = [None] * num_envs
        self._small = [spec for spec in task.sensors if is_small(task.capacity[spec.name], len(spec.columns))]
        self._large = [spec for spec in task.sensors if spec not in self._small]
        self._rows = {spec.name: np.zeros((num_envs, 0, len(spec.columns))) for spec in self._small}
        self._now_s = np.zeros((num_envs, 0))
        self._ends: IntArray = np.zeros((len(task.sensors), num_envs, 0), dtype=np.int64)
        self.target = np.zeros((num_envs, 0, 3))
        self.answers = np.zeros((num_envs, 0, action_width))
        self.length: IntArray = np.zeros(num_envs, dtype=np.int64)
        self.is_rewarded: FloatArray = np.zeros(num_envs)

    def episode(self, env: int) -> Episode:
        """The walk in a slot."""
        episode = self._episodes[env]
        assert episode is not None
        return episode

    def begun(self, walk: str) -> Episode | None:
        """A walk that is in play already, from its beginning."""
        episodes = (episode for episode in self._episodes if episode is not None)
        return next((episode.fresh() for episode in episodes if episode.recording.id == walk), None)

    def put(self, env: int, episode: Episode, target: FloatArray | None) -> None:
        """Fills a slot; `target` is what `target_of` gives, None where nothing is rewarded."""
        steps = len(episode)
        self._episodes[env] = episode
        self.length[env] = steps
        self._now_s = _with_room(self._now_s, 1, steps + 1)
        self._now_s[env, : steps + 1] = episode.now_s
        self._ends = _with_room(self._ends, 2, steps + 2)
        for sensor, spec in enumerate(self._task.sensors):
            self._ends[sensor, env, : steps + 2] = episode.ends[spec.name]
        self.target = _with_room(self.target, 1, steps + 1)
        self.is_rewarded[env] = target is not None
        if target is not None:
            self.target[env, :steps] = target
        self.answers = _with_room(self.answers, 1, steps + 1)
        for spec in self._small:
            rows = episode.rows[spec.name]
            self._rows[spec.name] = _with_room(self._rows[spec.name], 1, len(rows) + 1)
            self._rows[spec.name][env, : len(rows)] = rows

    def observe(self, step: IntArray) -> dict[str, FloatArray]:
        """The observations `step` (num_envs,), every array new."""
        first, last = self._ends[:, self._env, step], self._ends[:, self._env, step + 1]
        count = last - first
        arrays: dict[str, FloatArray] = {NOW: self._now_s[self._env, step].reshape(-1, 1)}
        for sensor, spec in enumerate(self._task.sensors):
            arrays[count_key(spec.name)] = count[sensor].astype(np.float64).reshape(-1, 1)
            frames = np.zeros((len(step), self._task.capacity[spec.name], len(spec.columns)))
            if spec.name in self._rows:
                rows = self._rows[spec.name]
                begin = first[sensor] + self._env * rows.shape[1]
                pad(rows.reshape(-1, rows.shape[2]), begin, count[sensor], out=frames)
            else:  # memory that is large and mostly zero is touched only where rows came
                for env in np.flatnonzero(count[sensor]).tolist():
                    new = self.episode(env).rows[spec.name][first[sensor, env] : last[sensor, env]]
                    frames[env, : len(new)] = new
            arrays[spec.name] = frames
        return {key: arrays[key] for key in self._keys}


def _with_room(array: NDArray[Any], axis: int, length: int) -> NDArray[Any]:
    """`array`, or a copy with at least `length` entries along `axis`."""
    if array.shape[axis] >= length:
        return array
    shape = list(array.shape)
    shape[axis] = length
    longer = np.zeros(shape, dtype=array.dtype)
    longer[tuple(slice(size) for size in array.shape)] = array
    return longer
