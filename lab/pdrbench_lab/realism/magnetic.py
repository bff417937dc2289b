"""Realism of the magnetic field on walks with a phone (sources.md 1.7)."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench.inertial.quaternions import to_world
from pdrbench.recording import Recording
from pdrbench_lab.realism.block import (
    Block,
    Control,
    Distribution,
    Figure,
    Part,
    RealismStatistic,
    Values,
    Within,
    statistics,
)
from pdrbench_lab.realism.phone_walks import DATASET, NUM_WALKS, recorded_walks, resampled, synthetic_walks
from pdrbench_lab.realism.wide_field import draw_magnetic_field
from pdrbench_sim.fields.magnetic import FOOT_M
from pdrbench_sim.people.body_line import arc_length_m

LAGS_M: Final = (0.75, 2.5, 3.5, 5.0, 7.0, 10.0)  # sources.md 1.7
SPACING_M: Final = 0.25  # of the strength along the way
COMPASS_M: Final = (FOOT_M, 0.3, 1.0)  # heights above the floor: shoe, the border of W19, hip
PLACES: Final = 200  # on a floor of 100 m by 100 m


WalkField = tuple[FloatArray, FloatArray]


def walk_field(recording: Recording) -> WalkField:
    """The field that a magnetometer met between the first mark of a walk and the last one.

    The way between two marks is taken to be walked evenly, since no more is known of it.

    Returns:
        (n,) strength in microtesla, evenly along the way, `SPACING_M` apart; (m,) angle in radians from the north that
        the phone takes to be north to the horizontal field, less its mean.
    """
    way, mag, rotation = recording.reference, *(recording.streams[name].rows for name in ("mag", "rotation"))
    during = mag[(mag[:, 0] >= way.t_s[0]) & (mag[:, 0] <= way.t_s[-1])]
    at_mark_m = arc_length_m(way.xy_m)
    at_m = np.interp(during[:, 0], way.t_s, at_mark_m)
    even_m = np.arange(0.0, at_mark_m[-1], SPACING_M)
    row = np.clip(np.searchsorted(rotation[:, 0], during[:, 0]), 0, len(rotation) - 1)
    east, north, _ = to_world(rotation[row, 1:5], during[:, 1:4]).T
    angle_rad = np.arctan2(-east, north)
    strength_ut = np.interp(even_m, at_m, np.linalg.norm(during[:, 1:4], axis=1))
    return strength_ut, wrap_rad(angle_rad - np.angle(np.exp(1j * angle_rad).mean()))


def pooled_correlation(strength_ut: Sequence[FloatArray]) -> FloatArray:
    """(6,) correlation of the strength at `LAGS_M`: sums of products over all walks, each less its mean."""
    change = [values - values.mean() for values in strength_ut]
    variance = np.concatenate(change).var()
    correlation = []
    for lag in np.rint(np.array(LAGS_M) / SPACING_M).astype(int).tolist():
        products = np.concatenate([values[:-lag] * values[lag:] for values in change if len(values) > lag])
        correlation.append(float(products.mean() / variance))
    return np.array(correlation)


def _key(lag_m: float) -> str:
    return f"correlation_{lag_m:g}"


def _fields(fields: Sequence[WalkField], sets: Sequence[IntArray]) -> Values:
    """Statistics of walks."""
    correlation = np.array([pooled_correlation([fields[walk][0] for walk in walks]) for walks in sets])
    return {
        "strength": np.array([strength_ut.mean() for strength_ut, _ in fields]),
        "spread": np.array([strength_ut.std() for strength_ut, _ in fields]),
        "anomaly": np.degrees([anomaly_rad.std() for _, anomaly_rad in fields]),
        **{_key(lag): values for lag, values in zip(LAGS_M, correlation.T, strict=True)},
    }


def compass_errors_deg(seed: int, count: int) -> dict[str, FloatArray]:
    """(count,) median error of a level compass over a floor, at each of `COMPASS_M` above it."""
    errors: dict[str, list[float]] = {f"compass_{height_m:g}": [] for height_m in COMPASS_M}
    for number in range(count):
        rng = np.random.default_rng([seed, number, 19])
        field = draw_magnetic_field(rng, [0.0])
        xy_m = rng.uniform(0.0, 100.0, (PLACES, 2))
        for height_m, found in zip(COMPASS_M, errors.values(), strict=True):
            east, north, _ = field.at(np.column_stack([xy_m, np.full(PLACES, height_m)])).T
            found.append(float(np.degrees(np.median(np.abs(np.arctan2(east, north))))))
    return {name: np.array(found) for name, found in errors.items()}


def _real(part: Part) -> Values:
    walks = recorded_walks(part)
    return _fields([walk_field(walk) for walk in walks], [np.arange(len(walks))])


@functools.lru_cache(maxsize=2)
def _synthetic_fields(seed: int, count: int) -> tuple[WalkField, ...]:
    return tuple(walk_field(walk) for walk in synthetic_walks(seed, count))


def _synthetic(seed: int, count: int) -> Values:
    fields = _synthetic_fields(seed, count)
    return {**_fields(fields, resampled(count, seed)), **compass_errors_deg(seed, count)}


def _shuffled(seed: int, count: int) -> Values:
    """The same strengths in random order: white noise of that size."""
    rng = np.random.default_rng([seed, 7])
    fields = [(rng.permutation(strength), anomaly) for strength, anomaly in _synthetic_fields(seed, count)]
    return _fields(fields, resampled(count, seed))


_W19: Final = "Woodman & Harle 2008: useless within 30 cm of the floor"
MAGNETIC: Final = Block(
    name="Mag",
    statistics=(
        *statistics(
            "walk",
            Distribution(),
            ("strength", "mean strength of the field along a walk", "uT"),
            ("spread", "standard deviation of the strength along a walk", "uT"),
            ("anomaly", "spread of the field's direction against the heading reported", "deg"),
        ),
        *statistics(
            "set",
            Figure(scale=1.0),
            *((_key(lag), f"correlation of the strength {lag:g} m apart", "") for lag in LAGS_M),
        ),
        RealismStatistic("compass_0.1", "median error of a compass on a shoe", "deg", "floor", Within(45, 90, _W19)),
        RealismStatistic("compass_0.3", "median error of a compass 0.3 m up", "deg", "floor", Within(15, 90, _W19)),
        RealismStatistic("compass_1", "median error of a compass at the hip", "deg", "floor", Within(2, 10, _W19)),
    ),
    datasets=(DATASET,),
    real=_real,
    synthetic=_synthetic,
    count=NUM_WALKS,
    controls={"shuffled field": Control("strengths in random order", _shuffled, _key(2.5))},
    features=("strength", "spread", "anomaly"),
)
