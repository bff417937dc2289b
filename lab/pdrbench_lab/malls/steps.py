"""Length of a step and turn between reported headings and the plan, fitted on walks of train and left out by fold."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.inertial import PeakStepDetector, phone_heading_rad
from pdrbench.recording import Recording
from pdrbench_envs.malls.environment import task
from pdrbench_lab.malls.pairing import clustered_mean

MIN_LEG_M: Final = 2.0
MIN_STEPS: Final = 3
STRAIGHT: Final = 0.95  # displacement over path of the steps of a leg: a property of the headings, not of the outcome
STEP_M: Final = 0.63  # of `dead_reckoning`


@dataclass(frozen=True, slots=True, eq=False)
class SteppedWalk:
    """Legs between successive surveyed places, and the steps taken on each.

    Attributes:
        site: The mall.
        unit: The outing.
        fold: Its fold.
        leg_m: (L,) complex, x + iy from place to place.
        steps: (L,) complex sum over steps of unit vectors along the reported heading.
        count: (L,) number of steps.
    """

    site: str
    unit: str
    fold: int
    leg_m: FloatArray
    steps: FloatArray
    count: FloatArray

    @property
    def straight(self) -> BoolArray:
        """(L,) bool, legs walked straight ahead."""
        is_long = (np.abs(self.leg_m) > MIN_LEG_M) & (self.count >= MIN_STEPS)
        straight: BoolArray = is_long & (np.abs(self.steps) >= STRAIGHT * self.count)
        return straight

    def errors_m(self, step_m: float, turn_rad: float) -> FloatArray:
        """(L,) distance of reckoned places from those surveyed, from the first one on."""
        off: FloatArray = np.abs(np.cumsum(step_m * np.exp(1j * turn_rad) * self.steps - self.leg_m))
        return off


def stepped_walks(jobs: int = 1) -> list[SteppedWalk]:
    """All walks of train with two surveyed places or more."""
    walks = Parallel(n_jobs=jobs)(delayed(_stepped)(walk) for walk in task().split("train"))
    return [walk for walk in walks if len(walk.leg_m)]


def _stepped(walk: str) -> SteppedWalk:
    played = _task()
    recording = played.load(walk)
    places = recording.reference
    place = places.xy_m[:, 0] + 1j * places.xy_m[:, 1]
    t_s, unit_step = _steps_of(recording)
    row = np.searchsorted(t_s, places.t_s)
    sums = np.concatenate([[0.0], np.cumsum(unit_step)])[row]
    site = walk.partition("-")[0]
    return SteppedWalk(
        site, played.units[walk], played.folds[walk], np.diff(place), np.diff(sums), np.diff(row).astype(np.float64)
    )


_task = functools.cache(task)


def _steps_of(recording: Recording) -> tuple[FloatArray, FloatArray]:
    """(S,) times of steps, and (S,) complex unit vectors along the reported heading then.

    Steps are found as `dead_reckoning` finds them, since the tables say what its errors are made of.
    """
    accel, rotation = (recording.streams[sensor].rows for sensor in ("accel", "rotation"))
    rate_hz = (len(accel) - 1) / (accel[-1, 0] - accel[0, 0])
    t_s = PeakStepDetector(float(rate_hz)).update(accel)
    row = np.maximum(np.searchsorted(rotation[:, 0], t_s, side="right") - 1, 0)
    return t_s, np.exp(1j * phone_heading_rad(rotation[row, 1:5]))


def fitted(walks: Sequence[SteppedWalk]) -> tuple[float, float]:
    """Length of a step in metres and turn in radians, counter-clockwise from the reported heading to the plan.

    Length: legs walked straight over their steps. Turn: of the vector sum of those legs against that of their steps.
    """
    legs = [(walk.leg_m[walk.straight], walk.steps[walk.straight], walk.count[walk.straight]) for walk in walks]
    leg_m, steps, count = (np.concatenate(part) for part in zip(*legs, strict=True))
    return float(np.abs(leg_m).sum() / count.sum()), float(np.angle(np.sum(np.conj(steps) * leg_m)))


def rows_of_sites(walks: Sequence[SteppedWalk]) -> list[dict[str, Any]]:
    """Length and turn by mall, with standard errors by outing."""
    rows = []
    for site in ("", *sorted({walk.site for walk in walks})):
        here = [walk for walk in walks if site in ("", walk.site) and walk.straight.any()]
        leg_m = np.array([np.abs(walk.leg_m[walk.straight]).sum() for walk in here])
        count = np.array([walk.count[walk.straight].sum() for walk in here])
        cross = [np.sum(np.conj(walk.steps) * walk.leg_m, where=walk.straight) for walk in here]
        units = [walk.unit for walk in here]
        length_m, length_se = clustered_mean(leg_m / count, units, count)
        turn_deg, turn_se = clustered_mean(np.degrees(np.angle(cross)), units, leg_m)
        spread_deg = float(np.std(np.degrees(np.angle(cross))))
        rows.append(
            {
                "mall": site or "both",
                "walks": len(here),
                "outings": len(set(units)),
                "step": f"{length_m:.3f} ± {length_se:.3f} m",
                "turn": f"{turn_deg:+.1f} ± {turn_se:.1f}°",
                "spread of turns": f"{spread_deg:.0f}°",
            }
        )
    return rows


def rows_left_out(walks: Sequence[SteppedWalk]) -> list[dict[str, Any]]:
    """Mean error of dead reckoning over walks, with length and turn fitted on the folds that a walk is not in."""
    others = {fold: fitted([walk for walk in walks if walk.fold != fold]) for fold in {walk.fold for walk in walks}}
    units = [walk.unit for walk in walks]
    usual = np.array([walk.errors_m(STEP_M, 0.0).mean() for walk in walks])
    rows = []
    for name, is_length, is_turn in (
        (f"steps of {STEP_M} m, headings as reported", False, False),
        ("length fitted", True, False),
        ("turn fitted", False, True),
        ("both fitted", True, True),
    ):
        settings = [(others[w.fold][0] if is_length else STEP_M, others[w.fold][1] if is_turn else 0.0) for w in walks]
        error_m = np.array([walk.errors_m(*each).mean() for walk, each in zip(walks, settings, strict=True)])
        change_m, se_m = clustered_mean(error_m - usual, units)
        row = {"dead reckoning": name, "mean error": f"{error_m.mean():.2f} m"}
        rows.append(row | {"difference": f"{change_m:+.2f} ± {se_m:.2f} m" if is_length or is_turn else "-"})
    return rows
