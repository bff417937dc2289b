"""Which localizer to believe on walks that were tried, and what about them nobody should believe."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pdrbench.episode import Episode
from pdrbench.evaluation.suitability import declining
from pdrbench.registry import make_task
from pdrbench.result import FAILED, ONLINE, UNSUITABLE, Result, shown_name
from pdrbench_formats.taskfile.motion import lag_s, lay_still

if TYPE_CHECKING:
    from pdrbench.recording import Recording
    from pdrbench_formats.taskfile.load import Walks

# docs/choose.md, the best first: each declines what it lacks, so the first that plays is the one to take.
ADVISED: Final = (
    *("fusion", "foot_ins_robust", "wifi_knn", "learned", "li2012", "woodman2008", "koeping2012"),
    *("foot_ins", "gp_wifi", "dead_reckoning"),
)
BY_YAW: Final = ("fusion", "learned")  # of five walks in pockets without an attitude all were 30 to 140 degrees off
ON_PLAN: Final = ("fusion", "li2012")  # of three walks without a heading fusion lost two (12 and 45 m)
STANDING: Final = "stay"  # is right at the end of every loop, and wrong on the way
NUM_ADVISED: Final = 3  # as many paths as a picture shows apart
ALIGNED: Final = "ate_se2_aligned_m"
MEAN: Final = "mean_m"
CHANCE: Final = 1.1  # times the least error: of 14 simulated walks with 11 places, that takes the best of each
MIN_PLACES: Final = 3  # two are turned onto any other two of the same distance
OUTSIDE: Final = 0.2  # of a path: more is not the noise of a path along a wall


def advised(suited: Iterable[str], walks: Walks) -> tuple[str, ...]:
    """The first few that suit, as `order` has them; who stands still where there is no other."""
    known = set(suited)
    return tuple(name for name in order(walks) if name in known)[:NUM_ADVISED] or (STANDING,)


def order(walks: Walks) -> tuple[str, ...]:
    """`ADVISED`; without a heading at the start, which lets walls choose a wrong way, those on the plan come last, and
    with that of a walker whose pocket turns the phone those that take it for that of the phone."""
    loaded = (walks.task.load(walk) for walk in walks.facts if walk not in walks.refused)
    late = ON_PLAN if lacks_heading(walks) else BY_YAW if any(map(_is_turned, loaded)) else ()
    return tuple(sorted(ADVISED, key=lambda name: name in late))


def _is_turned(walk: Recording) -> bool:
    """Whether a phone on a plan that need not point ahead has the yaw of its walker, as its attitude was derived."""
    rotation = walk.streams.get("rotation") if walk.building is not None else None
    return walk.mounting not in ("", "hand", "foot") and rotation is not None and rotation.spec.derived


def is_aligned(walks: Walks) -> bool:
    """Whether paths are turned onto the places before they are compared: no heading, and places enough for a shape."""
    places = [int(walks.task.load(walk).reference.surveyed.sum()) for walk in walks.facts if walk not in walks.refused]
    return lacks_heading(walks) and min(places, default=0) >= MIN_PLACES


def lacks_heading(walks: Walks) -> bool:
    """Whether a start is known on a walk, and the heading there is not: every path may be turned."""
    if walks.task.start == "unknown":
        return False
    starts = [walks.task.tell_start(walks.task.load(walk)) for walk in walks.facts if walk not in walks.refused]
    return any(start is not None and start.heading_rad is None for start in starts)


def believed(rows: Sequence[Mapping[str, Any]], results: Sequence[Result], walks: Walks) -> tuple[str, str]:
    """The localizer to believe, and why, in a sentence: who errs least at the places, else whom `ADVISED` has first.

    One that failed, lacks a walk or stands still is never believed. What was revised stands before the same online.
    """
    broken = {result.localizer for result in results if result.status in (FAILED, UNSUITABLE)} | {STANDING}
    first = [*order(walks), *(result.localizer for result in results)]
    own = sorted((first.index(one.localizer), one.division == ONLINE, one.localizer, one.division) for one in results)
    played = {shown_name(name, division): name for *_, name, division in own if name not in broken}
    if not played:
        return "", "no localizer to believe: none played every walk; the reasons stand below"
    if all(lay_still(walks.task.load(walk)) for walk in walks.facts if walk not in walks.refused):
        return "", "no localizer to believe: the device lay still all the time, nobody walked"
    metric, what = (ALIGNED, "once turned onto") if is_aligned(walks) else (MEAN, "on average at")
    errors = {name: error for name, error in errors_of(rows, metric).items() if name in played}
    best, choice = next(iter(played)), f"the choice for {_situation(walks)}"
    if not errors:
        return best, f"believe {best}: {choice}; no places show how far it errs"
    least = min(errors, key=lambda name: errors[name])
    if best == least or played[best] not in ADVISED or not errors.get(best, np.inf) <= CHANCE * errors[least]:
        return least, f"believe {least}: it errs least {what} your places, by {errors[least]:.2f} m"
    seen = f"it errs {what} your places by {errors[best]:.2f} m, {least} by {errors[least]:.2f} m"
    return best, f"believe {best}: {seen}, too close to tell, and it is {choice}"


def errors_of(rows: Sequence[Mapping[str, Any]], metric: str) -> dict[str, float]:
    """A metric by localizer, where it has one."""
    return {
        shown_name(row["localizer"], row["division"]): float(row["metrics"][metric]["value"])
        for row in rows
        if row["metrics"].get(metric, {}).get("value") is not None
    }


def _situation(walks: Walks) -> str:
    """What decides who is best: what was carried where, plan and start."""
    recording = walks.task.load(next(iter(walks.facts)))
    carried = (
        "a shoe" if recording.mounting == "foot" else "a phone" if "accel" in recording.streams else "such sensors"
    )
    if recording.building is None and not walks.survey.files:
        return f"{carried} without a plan"
    plan = "with a plan" if recording.building is not None else "with a survey"
    return f"{carried} {plan} and {'no' if walks.task.start == 'unknown' else 'a known'} start"


def doubts(walks: Walks, results: Sequence[Result], best: str) -> Iterator[str]:
    """What cannot be meant of a walk, a sentence each: it lay still, begins outside of the plan, or leaves it."""
    for walk in (walk for walk in walks.facts if walk not in walks.refused):
        recording = walks.task.load(walk)
        if best and lay_still(recording):
            yield f"{walk}: the device lay still all the time: nobody walked, and paths say nothing"
        if lag := lag_s(recording):
            yield f"{walk}: the places fit the sensors best {lag:+g} s off: --truth-offset {-lag:g} moves them"
        if recording.building is None:
            continue
        start = None if walks.task.start == "unknown" else walks.task.tell_start(recording)
        if start is not None and not recording.building.contains(start.xy_m[None], np.array([start.level]))[0]:
            x_m, y_m = start.xy_m
            yield f"{walk}: the start ({x_m:.1f}, {y_m:.1f}) on level {start.level} lies outside of the plan"
        for result in results:
            if (result.walk, shown_name(result.localizer, result.division)) != (walk, best):
                continue
            own = result.estimates.given
            inside = recording.building.contains(result.estimates.xy_m[own], result.estimates.level[own])
            if own.any() and (~inside).mean() > OUTSIDE:
                yield f"{walk}: {(~inside).mean():.0%} of the path of {best} lies outside of the plan"


def declined_results(names: Iterable[str], env: str, split: str, walks: Iterable[str]) -> list[Result]:
    """A result on these walks for each localizer that declines an environment, see `declining`."""
    task = make_task(env)
    episodes = [Episode(task.load(walk), task) for walk in walks]
    return [
        episode.result(localizer=name, seed=0, status=UNSUITABLE, failure=reason)
        for name, reason in declining(names, env, split).items()
        for episode in episodes
    ]
