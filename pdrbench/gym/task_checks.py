"""Conformance of an environment: rules that each keeps, and the likely cause where one does not."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, cast

import numpy as np
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

from pdrbench.episode import CLOCK_SLACK_S, Episode, delivery_table
from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench.gym.checking import Check, RefutedError, by_env, by_episode, only, require, require_equal, run_check
from pdrbench.gym.env import LocalizationEnv
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.metrics.ranking import smallest_ratio
from pdrbench.metrics.statistics import MIN_UNITS
from pdrbench.recording import Recording
from pdrbench.registry import make_task
from pdrbench.task import SPLITS, SURVEYS, Task
from pdrbench.trajectory import Estimates, Trajectory

MIN_INSIDE_FRACTION: Final = 0.9  # of the reference in the walkable area; what surveys of real malls exceed by far
START_SLACK_M: Final = 5.0  # between the briefed start and the reference, beyond its radius
MAX_BEGIN_S: Final = 60.0  # a stream that begins later has a clock of its own
EXACT_M: Final = 1e-9
BRACKETED: Final = "mean_level_penalised_m"  # the score that an oracle and standing still bracket
PUBLISHED_RATIO: Final = 1.25  # that a board tells between neighbours, at least
# Of the logarithm of the ratio of neighbours in a ranking, between units: 0.55 to 0.6 on strides, feet and phones
NEIGHBOUR_SPREAD: Final = 0.6
SOME_WALKS: Final = 8  # in as many buildings: then every walk is taken to have its own
SAME_SCAN_READINGS: Final = 10  # as many equal readings do not come by chance


def check_task(task: str | Task, *, walks: int = 2) -> list[Check]:
    """Tests one environment.

    Args:
        task: Registered id or the task itself.
        walks: How many walks of each split are looked at.

    Raises:
        DatasetError: Its recorded data is not found: nothing can be checked.
    """
    try:
        task = make_task(task) if isinstance(task, str) else task
    except DatasetError:
        raise
    except PdrbenchError as error:
        return [Check("is registered and loads", False, str(error))]
    played = {split: ids[:walks] for split, ids in task.walks.items() if ids}
    try:
        loaded = {walk: task.load(walk) for ids in played.values() for walk in ids}
    except DatasetError:
        raise
    except Exception as error:  # noqa: BLE001  the task under test may raise anything, and that is what is reported
        return [Check("walks load", False, f"{type(error).__name__}: {error}")]
    surveys: dict[str, Any] = {kind: _made_once(getattr(task, kind)) for kind in SURVEYS}
    cached = dataclasses.replace(task, load=lambda walk: loaded[walk], walks=played, **surveys)
    looks: dict[str, Callable[[], str | None]] = {
        "splits are there": lambda: _splits(task),
        "walks load twice the same": lambda: _loads_the_same(task, loaded),
        "test walks have opaque ids": lambda: _opaque(task),
        "everything recorded is delivered, nothing early": lambda: _each(cached, _deliveries),
        "observations own their memory": lambda: _each(cached, _owned_memory),
        "the building holds the reference": lambda: _each(cached, _inside),
        "the briefed start is where the walk begins": lambda: _each(cached, _start_fits),
        "something is scored, and not the briefed start": lambda: _each(cached, _scored),
        "the briefing holds no truth": lambda: _each(cached, _no_truth),
        "the radio map leaves out the walk's own scans": lambda: _each(cached, _no_own_scans),
        "an oracle has no error, and standing still has more": lambda: _each(cached, _brackets),
        "the observation space holds every observation": lambda: _spaces(cached),
        "test splits reward nothing": lambda: _rewards(cached),
        "gymnasium's check_env passes": lambda: _gymnasium(cached),
        "its walks tell localizers apart": lambda: _tells_apart(task, loaded),
        "a seed fixes the order of walks": lambda: _seeded(cached),
        "both roads give the same estimates": lambda: _each(cached, _both_roads),
    }
    return [
        Check("walks load", True, f"{len(loaded)} looked at"),
        *(run_check(name, look) for name, look in looks.items()),
    ]


def _made_once(survey: Callable[[Recording], Any]) -> Callable[[Recording], Any]:
    """The same survey each time it is asked for: making one takes longer than most checks of a walk."""
    made: dict[str, Any] = {}

    def of(recording: Recording) -> Any:
        if recording.id not in made:
            made[recording.id] = survey(recording)
        return made[recording.id]

    return of


def _each(task: Task, look: Callable[[Task, Recording], str | None]) -> str:
    """Runs a check on every walk and joins the remarks."""
    remarks = []
    for split, ids in task.walks.items():
        for walk in ids:
            try:
                remark = look(task, task.load(walk))
            except RefutedError as error:
                raise RefutedError(f"{split} walk {walk}: {error}") from error
            if remark:
                remarks.append(f"{walk}: {remark}")
    return "; ".join(remarks)


def _splits(task: Task) -> str:
    require(task.walks.get("test"), "there is no test split; scores are compared on it")
    remark = ", ".join(f"{split} {len(task.walks.get(split, ()))}" for split in SPLITS)
    return remark if task.walks.get("train") else f"{remark}; nothing to tune on, so tune elsewhere"


def _tells_apart(task: Task, loaded: Mapping[str, Recording]) -> str:
    """Warns where so few units rank that neighbours cannot be separated; `pdrbench power` measures instead."""
    walks = task.walks.get("test") or task.split(task.default_split)
    units = set(map(task.units.get, walks)) if task.units else _buildings(task, walks, loaded)
    count = len(units) if len(units) >= MIN_UNITS else len(walks)
    if count < 2:
        return f"warning: one walk says nothing; see pdrbench power {task.id}"
    ratio = smallest_ratio(NEIGHBOUR_SPREAD / math.sqrt(count), count - 1)
    limit = f"ratios from about {ratio:.2f} on are seen between neighbours"
    is_enough = ratio <= PUBLISHED_RATIO
    return limit if is_enough else f"warning: {limit}, a board needs {PUBLISHED_RATIO}; see pdrbench power {task.id}"


def _buildings(task: Task, walks: Sequence[str], known: Mapping[str, Recording]) -> set[str]:
    """Names that tell the buildings of walks apart; where the first ones differ, every walk counts as another."""
    loaded = [(known.get(walk) or task.load(walk)).building for walk in walks[:SOME_WALKS]]
    names = {building.name for building in loaded if building is not None}
    if len(names) == len(loaded):
        return set(walks)
    loaded += [task.load(walk).building for walk in walks[SOME_WALKS:]]
    return {"" if building is None else building.name for building in loaded}


def _loads_the_same(task: Task, loaded: Mapping[str, Recording]) -> None:
    for walk, first in loaded.items():
        again = task.load(walk)
        require(again.id == walk, f"load({walk!r}) returns a recording called {again.id!r}; ids must agree")
        require(set(again.streams) == set(first.streams), f"walk {walk}: a second load has other streams")
        for name, stream in again.streams.items():
            is_same = stream.rows.tobytes() == first.streams[name].rows.tobytes()
            cause = "is there randomness without a fixed seed?"
            require(is_same, f"walk {walk}: a second load has other rows in {name!r}; {cause}")
        is_same = again.reference.xy_m.tobytes() == first.reference.xy_m.tobytes()
        require(is_same, f"walk {walk}: a second load has another reference")


def _opaque(task: Task) -> str:
    if task.dataset is None:
        return "generated: nothing to hide an id from"
    from pdrbench.datasets import datasets

    dataset = datasets().get(task.dataset)
    require(dataset is not None, f"task.dataset is {task.dataset!r}, which is not registered")
    stems = {str(file.path).rpartition("/")[2].partition(".")[0] for file in cast(Any, dataset).files}
    for walk in task.walks.get("test", ()):
        shown = next((stem for stem in stems if len(stem) > 3 and stem in walk), None)
        require(shown is None, f"test walk {walk!r} carries the name of its file, {shown!r}; use a digest")
    return f"compared with {len(stems)} file names"


def _deliveries(task: Task, recording: Recording) -> str | None:
    now_s, ends = delivery_table(recording, task)
    why = "the walk has a single observation; its streams and its reference are shorter than a period"
    require(len(now_s) > 1, why)
    late = 0
    for name, end in ends.items():
        stream = recording.streams.get(name)
        if stream is None or not len(stream.rows):
            continue
        t_s = stream.t_s
        require(end[-1] == len(t_s), f"{len(t_s) - end[-1]} rows of {name!r} are never delivered")
        step = np.searchsorted(end[1:], np.arange(len(t_s)), side="right")
        early = np.flatnonzero(t_s > now_s[step] + CLOCK_SLACK_S)
        require(not len(early), f"row {early[:1]} of {name!r} is delivered before its time")
        is_event = stream.spec.rate_hz is None  # such as a change of level, which may come late
        require(
            is_event or t_s[0] < MAX_BEGIN_S,
            f"{name!r} begins at {t_s[0]:.1f} s; times count from the start of the walk",
        )
        late += int((t_s <= now_s[step] - task.period_s).sum())
    return f"{late} rows come late for want of capacity" if late else None


def _owned_memory(task: Task, recording: Recording) -> None:
    episode = Episode(recording, task)
    while not episode.done:
        for name, rows in episode.observe().rows.items():
            require(rows.base is None and rows.flags.owndata, f"the rows of {name!r} are a view into the recording")
        episode.submit(None)
    env = LocalizationEnv(only(task, recording), task.split_of(recording.id))
    observation, _ = env.reset()
    for name, array in observation.items():
        require(array.base is None and array.flags.owndata, f"array {name!r} of env.reset is a view")


def _inside(task: Task, recording: Recording) -> str:
    building, reference = recording.building, recording.reference
    if building is None:
        return "no building"
    require(building.area_m2 > 0, "the building has no walkable area")
    foreign = sorted(set(reference.level.tolist()) - set(building.levels))
    require(not foreign, f"the reference visits levels {foreign}; the building has {building.levels}")
    inside = float(building.contains(reference.xy_m, reference.level).mean())
    why = f"{inside:.1%} of the reference lies in the walkable area; do map and reference share frame and levels?"
    require(inside >= MIN_INSIDE_FRACTION, why)
    return f"{inside:.1%} inside"


def _start_fits(task: Task, recording: Recording) -> str | None:
    start = task.brief(recording).start
    if start is None:
        require(task.start == "unknown", f"task.start is {task.start!r} and the briefing has none")
        return "no start"
    require(task.start != "unknown", "task.start is 'unknown' and the briefing has one")
    require(task.start != "pose" or start.radius_m <= START_SLACK_M, "task.start is 'pose', and a wide area is briefed")
    if not len(recording.reference):
        return "no reference"
    off_m = float(np.hypot(*(start.xy_m - recording.reference.xy_m[0])))
    require(
        off_m <= start.radius_m + START_SLACK_M,
        f"the briefed start is {off_m:.1f} m from where the reference begins, outside its radius of {start.radius_m} m",
    )
    level = int(recording.reference.level[0])
    require(start.level == level, f"the briefed start is on level {start.level}, the reference begins on {level}")
    return None


def _scored(task: Task, recording: Recording) -> str:
    scored = recording.reference.scored()
    require(len(scored), "no row of the reference is surveyed, so nothing is scored")
    start = task.brief(recording).start
    if start is not None and start.radius_m == 0 and scored.t_s[0] <= recording.reference.t_s[0]:
        is_start = np.array_equal(scored.xy_m[0], start.xy_m)
        require(not is_start, "the first scored position is the briefed start; mark it surveyed=False")
    return f"{len(scored)} scored"


def _arrays_in(thing: object, depth: int = 8) -> Iterator[NDArray[Any]]:
    """Arrays that can be reached from a record by its fields, items and memory."""
    if isinstance(thing, np.ndarray):
        yield thing
        if isinstance(thing.base, np.ndarray):
            yield from _arrays_in(thing.base, depth)
    elif depth and isinstance(thing, Mapping):
        for value in thing.values():
            yield from _arrays_in(value, depth - 1)
    elif depth and isinstance(thing, tuple | list | set | frozenset):
        for value in thing:
            yield from _arrays_in(value, depth - 1)
    elif depth and dataclasses.is_dataclass(thing):
        for item in dataclasses.fields(thing):
            yield from _arrays_in(getattr(thing, item.name), depth - 1)
    elif depth and hasattr(thing, "__dict__"):
        yield from _arrays_in(vars(thing), depth - 1)


def _shows_truth(array: NDArray[Any], reference: Trajectory) -> bool:
    """True where an array shares memory with the reference or holds its first positions, one after the other."""
    if np.may_share_memory(array, reference.xy_m) and np.shares_memory(array, reference.xy_m):
        return True
    run = reference.xy_m[:4]
    if array.ndim != 2 or array.shape[1] < 2 or len(array) < len(run) or len(run) < 3 or array.dtype.kind != "f":
        return False
    begins = np.flatnonzero((array[: len(array) - len(run) + 1, :2] == run[0]).all(axis=1))
    return any(np.array_equal(array[begin : begin + len(run), :2], run) for begin in begins.tolist())


def _no_truth(task: Task, recording: Recording) -> None:
    briefing = task.brief(recording)
    remedy = "a localizer could read where it is going"
    for array in _arrays_in(briefing):
        shown = _shows_truth(array, recording.reference)
        require(not shown, f"an array {array.shape} of the briefing is the reference; {remedy}")
    for name in (spec.name for spec in task.sensors if spec.name in recording.streams):
        shown = _shows_truth(recording.streams[name].rows[:, 1:], recording.reference)
        require(not shown, f"the rows of {name!r} are the reference; {remedy}")
    env = LocalizationEnv(only(task, recording), task.split_of(recording.id))
    _, info = env.reset()
    require(set(info) == {"briefing"}, f"info of reset holds {sorted(info)}; expected the briefing only")
    _, _, _, _, info = env.step(np.full(3, np.nan))
    require(set(info) <= {"result"}, f"info of step holds {sorted(info)}")
    texts = repr(env) + repr(Episode(recording, task))
    start_xy_m = None if briefing.start is None else briefing.start.xy_m.tolist()
    for row in recording.reference.scored().xy_m[:20].tolist():
        hidden = row == start_xy_m or not all(repr(value) in texts for value in row)
        require(hidden, "repr() shows a position of the reference")


def _no_own_scans(task: Task, recording: Recording) -> str:
    radio_map, wifi = task.radio_map(recording), recording.streams.get("wifi")
    if radio_map is None or wifi is None or not len(wifi.rows):
        return "no radio map" if radio_map is None else "no scans"
    scans = map(slice, radio_map.first[:-1], radio_map.first[1:])
    surveyed = {_readings(radio_map.access_point[scan], radio_map.rssi_dbm[scan]) for scan in scans}
    heard, rssi_dbm = wifi.column("access_point"), wifi.column("rssi_dbm")
    for t_s in np.unique(wifi.t_s)[:20]:
        now = wifi.t_s == t_s
        own = _readings(heard[now], rssi_dbm[now])
        require(
            len(own) < SAME_SCAN_READINGS or own not in surveyed,
            f"the scan at {t_s:.1f} s is in the radio map, with its place; leave the recording's own scans out",
        )
    return f"{len(radio_map)} scans in the map"


def _readings(access_point: NDArray[Any], rssi_dbm: FloatArray) -> frozenset[tuple[float, float]]:
    return frozenset(zip(access_point.tolist(), rssi_dbm.tolist(), strict=True))


def _brackets(task: Task, recording: Recording) -> str | None:
    from pdrbench.metrics.hold import HOLD_SLACK_S
    from pdrbench.metrics.scoring import score

    reference = recording.reference.scored()
    now_s, _ = delivery_table(recording, task)
    step = np.searchsorted(now_s, reference.t_s + HOLD_SLACK_S, side="right") - 1
    crowded = int((np.diff(step) == 0).sum())
    row = np.searchsorted(step, np.arange(len(now_s))).clip(max=len(reference) - 1)  # the next one, held after the last
    fallback = Episode(recording, task).fallback
    oracle = reference.xy_m[row], reference.level[row]
    stay = np.tile(fallback.xy_m, (len(now_s), 1)), np.full(len(now_s), fallback.level)
    unclaimed = np.full((3, len(now_s)), np.nan)
    best, worst = (
        score(Estimates(now_s, *places, *unclaimed), recording.reference, recording.building, fallback)[BRACKETED]
        for places in (oracle, stay)
    )
    is_exact = best <= EXACT_M
    require(is_exact or crowded, f"an oracle errs by {best:.3g} m on average; do reference and clock agree?")
    if len(reference) == 1 and worst == 0:
        return "only the end of a closed loop is scored: standing still has no error"
    require(worst > best, f"standing still errs by {worst:.3g} m, an oracle by {best:.3g} m; does the pedestrian walk?")
    if not crowded:
        return None
    return f"{crowded} of {len(reference)} scored positions share a period with the one before; an oracle errs there"


def _spaces(task: Task) -> None:
    for split, ids in task.walks.items():
        env = LocalizationEnv(task, split)
        observation, _ = env.reset(options={"walk": ids[0]})
        terminated = False
        while not terminated:
            if observation not in env.observation_space:
                boxes = cast(spaces.Dict, env.observation_space).spaces
                key = next(key for key, box in boxes.items() if observation[key] not in box)
                raise RefutedError(
                    f"{split} walk {ids[0]}: {key!r} at {float(observation['now_s'][0]):.1f} s is outside its box; "
                    f"are low and high of the sensor wide enough?"
                )
            observation, _, terminated, _, _ = env.step(np.zeros(3))


def _rewards(task: Task) -> None:
    for split, ids in task.walks.items():
        env = LocalizationEnv(task, split)
        env.reset(options={"walk": ids[0]})
        rewards = [env.step(np.array([1000.0 * k, 0.0, 0.0]))[1] for k in range(2)]
        finite = all(math.isfinite(float(value)) for value in rewards)
        require(finite, f"rewards on {split} are {rewards}")
        withheld = split != "test" or rewards == [0.0, 0.0]
        require(withheld, f"a step on the test split is rewarded with {rewards}; three rewards give the truth away")


def _gymnasium(task: Task) -> None:
    for split in task.walks:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a position in metres is no normalised action, and is not meant to be
            check_env(LocalizationEnv(task, split), skip_render_check=True)


def _seeded(task: Task) -> None:
    for split, ids in task.walks.items():
        first, second = LocalizationEnv(task, split), LocalizationEnv(task, split)
        for number in range(len(ids) + 1):
            seed = 5 if number == 0 else None
            one, two = first.reset(seed=seed)[0], second.reset(seed=seed)[0]
            require(all(one[key].tobytes() == two[key].tobytes() for key in one), f"{split}: reset {number} differs")


class _Probe:
    """Answers with a digest of everything it was handed so far."""

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self._sum = np.zeros(3)
        self._rng = rng

    def step(self, observation: Observation) -> Estimate:
        self._sum[0] += observation.now_s
        for place, rows in enumerate(observation.rows.values()):
            self._sum[1] += (place + 1) * float(rows.sum())
            self._sum[2] += len(rows)
        heading_rad, sigma_m = self._rng.uniform(0.0, 3.0, 2)
        level, xy_m = int(self._sum[2]) % 7, self._sum[:2] % 100.0
        return Estimate(xy_m, level, float(heading_rad), float(sigma_m), converged=[None, False, True][level % 3])


def _both_roads(task: Task, recording: Recording) -> None:
    alone = only(task, recording)
    played, driven = by_episode(_Probe(), alone, recording), by_env(_Probe(), alone, recording)
    require_equal(played, driven, "env.step differs from Episode")
