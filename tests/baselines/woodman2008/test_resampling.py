"""The compiled systematic resampling of many particles."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench_baselines.woodman2008 import resampling


@pytest.mark.parametrize("count", [100, 50_000])
def test_systematic_resampling_gives_every_particle_its_fraction(rng: np.random.Generator, count: int) -> None:
    """Systematic resampling: N w offspring, rounded up or down, in total exactly as many as asked for."""
    weight = np.where(rng.random(count) < 0.3, 0, rng.exponential(size=count)).astype(np.float32)
    weight[3] = weight.sum() * 0.05  # thousands of copies of one particle
    cells = np.sort(rng.integers(0, 7, count)).astype(np.int32)
    number = 3 * count
    before = np.concatenate([[0.0], np.cumsum(resampling.sum_weights(weight, count)[:, 0])])
    offspring = np.zeros((len(before) - 1, 7), np.int32)
    scale = number / before[-1]
    resampling.count_offspring(weight, cells, count, before, scale, 0.37, offspring)
    resampling.place_offspring(offspring, 5)
    ancestor = np.full(number + 5, -1, np.int32)
    resampling.choose_ancestors(weight, cells, count, before, scale, 0.37, offspring, ancestor)
    copies = np.bincount(ancestor[5:], minlength=count)
    assert copies.sum() == number
    assert np.abs(copies - weight.astype(np.float64) * scale).max() < 1 + 1e-6
    assert (np.diff(cells[ancestor[5:]]) >= 0).all()
    assert (ancestor[:5] == -1).all()
