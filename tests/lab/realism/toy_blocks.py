"""Blocks with values in closed form, for tests of the scorecard; imported by its processes as well."""

from __future__ import annotations

import os

import numpy as np

from pdrbench.errors import DatasetError
from pdrbench_lab.realism.block import Block, Control, Distribution, Figure, RealismStatistic, Values, Within


def real(part: str) -> Values:
    """100 walks (40 of the part `fit`) whose step times are 0.50 to 0.60 s."""
    count = 100 if part == "judge" else 40
    step_s = np.linspace(0.50, 0.60, count)
    return {"step_s": step_s, "spread_m": np.linspace(1.0, 2.0, count)[::-1], "n": np.array([3.0])}


def synthetic(seed: int, count: int) -> Values:
    """Walks that are a little more spread; the seed moves them by a hair."""
    step_s = np.linspace(0.49, 0.61, count) + 1e-6 * seed
    return {
        "step_s": step_s,
        "spread_m": np.linspace(0.9, 2.1, count)[::-1],
        "n": np.linspace(2.7, 3.3, 20),
        "alpha": np.full(5, 0.83),
    }


def too_slow(seed: int, count: int) -> Values:
    """The same at half the pace."""
    found = dict(synthetic(seed, count))
    return {**found, "step_s": 2 * found["step_s"]}


def unchanged(seed: int, count: int) -> Values:
    """A control that disturbs nothing."""
    return synthetic(seed, count)


def missing(part: str) -> Values:
    raise DatasetError("the dataset 'ilc20' is not available; fetch it")


def broken(seed: int, count: int) -> Values:
    raise ZeroDivisionError("no walks at all")


def deadly(seed: int, count: int) -> Values:
    os._exit(3)


_STATISTICS = (
    RealismStatistic("step_s", "time of a step", "s", "walk", Distribution()),
    RealismStatistic("spread_m", "spread of errors", "m", "walk", Distribution()),
    RealismStatistic("n", "walks of a set", "", "set", Figure()),
    RealismStatistic("alpha", "scaling exponent", "", "walk", Within(0.73, 0.93, "a paper")),
)
WALK = Block(
    name="Toy walk",
    statistics=_STATISTICS,
    datasets=("ilc20",),
    real=real,
    synthetic=synthetic,
    count=50,
    controls={
        "half pace": Control("at half the pace", too_slow, "step_s"),
        "nothing": Control("nothing changed", unchanged, "step_s"),
        "half pace, classified": Control("at half the pace", too_slow, "classifier"),
    },
    features=("step_s",),
)
PUBLISHED = Block(
    name="Toy law",
    statistics=(RealismStatistic("alpha", "scaling exponent", "", "walk", Within(0.9, 1.1, "a paper")),),
    datasets=(),
    real=missing,
    synthetic=synthetic,
    count=12,
)
BROKEN = Block(name="Toy ruin", statistics=_STATISTICS, datasets=("ilc20",), real=real, synthetic=broken)
DEADLY = Block(name="Toy end", statistics=_STATISTICS, datasets=("ilc20",), real=real, synthetic=deadly)
ABSENT = Block(name="Toy gap", statistics=_STATISTICS, datasets=("ilc20",), real=missing, synthetic=synthetic)
NOT_A_BLOCK = 3
