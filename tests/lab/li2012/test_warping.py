"""Distances of many waves at once are those of each two."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.inertial.warping import warped_distance
from pdrbench_lab.papers.li2012.warping import warped_distances


@pytest.mark.parametrize("band", [None, 0, 3])
def test_all_distances_are_single_ones(rng, band):
    waves = [rng.normal(size=size) for size in [*rng.integers(1, 9, 21), 30]]
    found = warped_distances(waves, band)
    each = [[warped_distance(one, other, band) for other in waves] for one in waves]
    np.testing.assert_allclose(found, each, rtol=1e-12)
    np.testing.assert_array_equal(found, found.T)
    np.testing.assert_array_equal(np.diag(found), 0.0)


@pytest.mark.parametrize(("waves", "band"), [([], None), ([[], [1.0]], None), ([[1.0], [1.0]], -1)])
def test_values_that_are_no_waves_are_refused(waves, band):
    with pytest.raises(PdrbenchError, match="band of 0 or more"):
        warped_distances([np.array(wave) for wave in waves], band)
