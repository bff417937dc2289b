"""One table of all feet: sets by disturbances, for the literal filter, `foot_ins_robust` and its revised row.

    python -m pdrbench_lab.foot_ins.table [NAME=VALUE ...] [DISTURBANCE ...]

NAME is a setting of `pdrbench.inertial.gaps`, to be tried.

Errors are root mean squares after alignment in m, of loops the closure in percent of the way; parts of a set are apart
by a stroke. In brackets is the share of the samples, in percent, inside the disc of 95 % that the filter claims. The
last columns are error over gate: the mean over sets, and over the worse half of them. A state or a setting stays where
it helps that, left out by set, see `chosen_without`.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import MappingProxyType
from typing import Final, NamedTuple

import numba
import numpy as np

from pdrbench.errors import RecordingError, RecordingWarning
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.inertial import LITERAL, FootStates, navigate, navigate_smoothed
from pdrbench.inertial import gaps as carrying
from pdrbench.inertial.zero_velocity import nominal_rate_hz
from pdrbench_lab.foot_ins.experiments import FootWalk, closure_m, places_m, rmse_m
from pdrbench_lab.foot_ins.sets import all_sets

GAP_EVERY_S: Final = 8.0
CLIP_RADPS, CLIP_MPS2 = math.radians(300.0), 8 * 9.80665
DISC: Final = math.sqrt(-2 * math.log(0.05))  # radius of 95 % over the sigma of an axis
CLOSES_M: Final = 0.01  # a loop closes to a centimetre
GATES: Final[Mapping[str, float]] = MappingProxyType(
    {"captures 2017": 0.08, "captures 2018": 0.12, "walks": 0.35, "loops": 0.15, "short": 0.15, "gaitmap": 0.20}
)
OTHER_GATE: Final = 0.35  # of both feet and of simulated units, m
REVISED: Final = ("whole", "gap_0.2", "gap_0.6")  # disturbances for which the revised row is shown, which takes longer

Walks = Mapping[str, Mapping[str, Sequence[FootWalk]]]


class Score(NamedTuple):
    """Of one walk: its error, and the share of it inside the disc of 95 %; nan and 0 where it is refused."""

    error: float
    inside: float


def kept(walk: FootWalk, rows: slice | BoolArray) -> FootWalk:
    """Some of the samples."""
    return replace(walk, t_s=walk.t_s[rows], accel=walk.accel[rows], gyro=walk.gyro[rows])


def gaps(lasts_s: float, later_s: float = 0.0) -> Callable[[FootWalk], FootWalk]:
    """So much is missing every `GAP_EVERY_S`, from a moment between 2 and 6 s on, or `later_s` after that."""

    def cut(walk: FootWalk) -> FootWalk:
        t_s = walk.t_s
        first_s = t_s[0] + 2.0 + later_s + np.random.default_rng(len(t_s)).uniform(0, 4)
        is_gone = (t_s >= first_s) & ((t_s - first_s) % GAP_EVERY_S < lasts_s) & (t_s < t_s[-1] - 1.5)
        return kept(walk, ~is_gone)

    return cut


def thinned(rate_hz: float) -> Callable[[FootWalk], FootWalk]:
    """Every n-th sample, with no filter before, so that about `rate_hz` a second are left."""

    def thin(walk: FootWalk) -> FootWalk:
        return kept(walk, slice(None, None, max(1, round(nominal_rate_hz(walk.t_s) / rate_hz))))

    return thin


def clipped(walk: FootWalk) -> FootWalk:
    """Sensors that end at 300 degrees/s and 8 g."""
    accel, gyro = np.clip(walk.accel, -CLIP_MPS2, CLIP_MPS2), np.clip(walk.gyro, -CLIP_RADPS, CLIP_RADPS)
    return replace(walk, accel=accel, gyro=gyro)


def repeated(walk: FootWalk) -> FootWalk:
    """In place of 2 % of the samples, one to five at a time, the last one comes again."""
    rng, at = np.random.default_rng(len(walk.t_s)), np.arange(len(walk.t_s))
    for begin in np.flatnonzero(rng.random(len(at)) < 0.02 / 3):
        if begin:
            at[begin : begin + rng.integers(1, 6)] = at[begin - 1]
    return replace(walk, accel=walk.accel[at], gyro=walk.gyro[at])


def lost(walk: FootWalk) -> FootWalk:
    """2 % of the samples are missing, one to five at a time."""
    rng, is_kept = np.random.default_rng(len(walk.t_s)), np.ones(len(walk.t_s), dtype=bool)
    for begin in np.flatnonzero(rng.random(len(is_kept)) < 0.02 / 3):
        is_kept[begin : begin + rng.integers(1, 6)] = False
    return kept(walk, is_kept)


def jittered(walk: FootWalk) -> FootWalk:
    """Stamps err by a tenth of the time between samples."""
    rng, step_s = np.random.default_rng(len(walk.t_s)), 1 / nominal_rate_hz(walk.t_s)
    t_s = walk.t_s + rng.normal(0, 0.1 * step_s, len(walk.t_s))
    t_s = np.maximum.accumulate(t_s)
    return replace(walk, t_s=t_s)


def bursts(walk: FootWalk) -> FootWalk:
    """A logger that stamps four samples at once."""
    at = np.minimum(np.arange(len(walk.t_s)) // 4 * 4 + 3, len(walk.t_s) - 1)
    return replace(walk, t_s=walk.t_s[at])


def scaled(walk: FootWalk) -> FootWalk:
    """The gyroscope shows 1 % too much."""
    return replace(walk, gyro=1.01 * walk.gyro)


DISTURBANCES: Final[Mapping[str, Callable[[FootWalk], FootWalk]]] = MappingProxyType(
    {
        "whole": lambda walk: walk,
        "gap_0.2": gaps(0.2),
        "gap_0.6": gaps(0.6),
        "gap_2": gaps(2.0),
        **{f"gap_{s:g}+{later_s:g}": gaps(s, later_s) for s in (0.2, 0.6) for later_s in (2.1, 4.3)},
        "50_hz": thinned(50.0),
        "100_hz": thinned(100.0),
        "clipped": clipped,
        "repeated": repeated,
        "lost": lost,
        "jitter": jittered,
        "bursts": bursts,
        "scaled": scaled,
    }
)
Navigate = Callable[[FootWalk], FootStates]
FILTERS: Final[Mapping[str, Navigate]] = MappingProxyType(
    {
        "literal": lambda walk: navigate(*walk.rows, LITERAL),
        "robust": lambda walk: navigate(*walk.rows),
        "revised": lambda walk: navigate_smoothed(*walk.rows),
    }
)


def score(walk: FootWalk, play: Navigate) -> Score:
    """Error and coverage of one walk; samples are judged in the frame that fits best with the start held."""
    try:
        states = play(walk)
    except RecordingError:
        return Score(math.nan, 0.0)
    if len(walk.reference) > 2:
        return Score(rmse_m(states, walk.reference), inside(states, walk))
    gap_m = float(np.hypot(*closure_m(states)[:2]))
    known = states.part(np.isfinite(states.x[:, 0]))
    every = max(1, round(0.05 * nominal_rate_hz(known.t_s)))
    way_m = float(np.hypot(*np.diff(known.position_m[::every, :2], axis=0).T).sum())
    return Score(100 * gap_m / way_m, float(gap_m < DISC * math.hypot(states.sigma_m[-1], CLOSES_M)))


def inside(states: FootStates, walk: FootWalk) -> float:
    """Share of the surveyed rows inside the disc of 95 %; the track is turned about the start onto the reference."""
    began_s = states.t_s[np.isfinite(states.x[:, 0])][0]
    seen = walk.reference.rows(walk.reference.surveyed & (walk.reference.t_s > began_s))
    track_m, onto_m = places_m(states, seen.t_s)[:, :2], seen.xy_m - walk.reference.xy_m[0]
    track, onto = track_m[:, 0] + 1j * track_m[:, 1], onto_m[:, 0] + 1j * onto_m[:, 1]
    turn = np.vdot(onto, track)
    off_m = np.abs(track - onto * turn / abs(turn))
    row = np.searchsorted(states.t_s, seen.t_s + 1e-6, side="right") - 1
    return float(np.mean(off_m < DISC * np.hypot(states.sigma_m[row], 1e-3)))


def scores(walks: Walks, play: Navigate) -> dict[str, dict[str, FloatArray]]:
    """(n, 2) error and coverage of the walks, by set and part."""
    flat = [walk for parts in walks.values() for part in parts.values() for walk in part]
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        found = iter(list(pool.map(lambda walk: score(walk, play), flat)))
    return {
        name: {part: np.array([next(found) for _ in group]) for part, group in parts.items()}
        for name, parts in walks.items()
    }


def ratio(parts: Mapping[str, FloatArray], name: str) -> float:
    """Mean over the parts of a set of error over gate."""
    gate = GATES.get(name, OTHER_GATE)
    return float(np.mean([np.nan_to_num(part[:, 0], nan=10 * gate).mean() / gate for part in parts.values()]))


def summary(found: Mapping[str, Mapping[str, FloatArray]], without: str = "") -> tuple[float, float]:
    """Mean over sets of error over gate, and that of the worse half."""
    ratios = sorted(ratio(parts, name) for name, parts in found.items() if name != without)
    return float(np.mean(ratios)), float(np.mean(ratios[len(ratios) // 2 :]))


def line(title: str, found: Mapping[str, Mapping[str, FloatArray]]) -> str:
    """One row of the table."""
    cells = []
    for parts in found.values():
        errors = [f"{np.nanmean(part[:, 0]):.3f}" for part in parts.values()]
        cover = np.mean([part[:, 1].mean() for part in parts.values()])
        cells.append(f"{'/'.join(errors)} ({100 * cover:.0f})")
    mean, worse = summary(found)
    return f"{title:18s} " + " ".join(f"{cell:>20s}" for cell in cells) + f" {mean:6.2f} {worse:6.2f}"


def chosen_without(tried: Mapping[str, Mapping[str, Mapping[str, FloatArray]]]) -> dict[str, str]:
    """For each set the one of several settings that is best on the worse half of the others.

    Args:
        tried: As of `scores`, by setting.
    """
    names = next(iter(tried.values()))
    return {name: min(tried, key=lambda one: summary(tried[one], without=name)[1]) for name in names}


def main() -> None:
    """Prints the table, of the disturbances that are named, or of all."""
    warnings.simplefilter("ignore", RecordingWarning)
    walks = all_sets()
    sys.stdout.write(f"{'':18s} " + " ".join(f"{name:>20s}" for name in walks) + "   mean worse\n")
    settings = [word.split("=") for word in sys.argv[1:] if "=" in word]
    for name, value in settings:
        setattr(carrying, name, float(value))
    for name in sys.argv[1 + len(settings) :] or DISTURBANCES:
        disturb = DISTURBANCES[name]
        changed = {of: {part: [disturb(w) for w in group] for part, group in ps.items()} for of, ps in walks.items()}
        for kind, play in FILTERS.items():
            if kind != "revised" or name in REVISED:
                sys.stdout.write(line(f"{name} {kind}", scores(changed, play)) + "\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
