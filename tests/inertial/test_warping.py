"""Dynamic time warping: properties of every such distance; tests of the laboratory have it against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.inertial.warping import warped_distance, z_scored


def test_a_band_of_nothing_is_the_euclidean_distance_and_a_wider_one_is_never_farther(rng):
    one, other = rng.normal(size=(2, 20))
    distances = [warped_distance(one, other, band) for band in range(21)]
    assert distances[0] == pytest.approx(np.linalg.norm(one - other))
    assert (np.diff(distances) <= 1e-12).all() and distances[-1] == pytest.approx(warped_distance(one, other))
    assert distances[-1] < 0.8 * distances[0]


def test_a_wave_is_as_near_as_can_be_to_itself_stretched():
    wave = np.sin(np.arange(20) / 3)
    assert warped_distance(wave, wave) == 0.0
    assert warped_distance(wave, np.repeat(wave, 2)) == 0.0
    assert warped_distance(wave, wave + 1.0) > 0.5


def test_z_scores_forget_size_and_height_and_leave_flat_waves_flat(rng):
    wave = rng.normal(size=30)
    np.testing.assert_allclose(z_scored(9.81 + 3 * wave), z_scored(wave), atol=1e-12)
    np.testing.assert_array_equal(z_scored(np.full(5, 9.81)), 0.0)


@pytest.mark.parametrize(("one", "other", "band"), [([], [1.0], None), ([1.0], [], 3), ([1.0], [1.0], -1)])
def test_values_that_are_no_wave_are_refused(one, other, band):
    with pytest.raises(PdrbenchError, match="band of 0 or more"):
        warped_distance(np.array(one), np.array(other), band)
