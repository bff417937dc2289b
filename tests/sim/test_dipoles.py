"""Single magnetic dipoles: the field of a dipole, where they lie, how strong they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import FloorRegion
from pdrbench.errors import MapError
from pdrbench_sim.fields.dipoles import DipoleParams, Dipoles, draw_dipoles
from pdrbench_sim.fields.magnetic import MagneticParams, Sheet, draw_field

SIDE_M = 200.0
SQUARE = FloorRegion(
    SIDE_M * np.array([[[0.0, 0], [1, 0], [1, 1]], [[0.0, 0], [1, 1], [0, 1]]]), np.zeros(2, dtype=int)
)
UPRIGHT = Dipoles(np.array([[0.0, 0.0, -1.0]]), np.array([[0.0, 0.0, 1000.0]]))


def drawn(seed: int, **changes) -> Dipoles:
    return draw_dipoles(np.random.default_rng(seed), SQUARE, replace(DipoleParams(), **changes))


def test_field_of_one_dipole_is_the_formula():
    """On its axis mu0 / (2 pi) m / r^3, 200 uT at 1 m; beside it, at half of its height, minus half of that."""
    above = UPRIGHT.at(np.zeros((2, 2)), np.array([0.0, 1.0]))
    np.testing.assert_allclose(above, [[0, 0, 200.0], [0, 0, 25.0]], atol=1e-9)
    lying = Dipoles(UPRIGHT.centre_m, np.array([[1000.0, 0.0, 0.0]]))
    np.testing.assert_allclose(lying.at(np.zeros((1, 2)), np.array([1.0])), [[-12.5, 0, 0]], atol=1e-9)


def test_near_a_dipole_there_is_neither_curl_nor_divergence():
    dipoles = drawn(1, per_m2=1 / 100)
    at_m = dipoles.centre_m + np.random.default_rng(2).normal(0, 1.0, dipoles.centre_m.shape)
    at_m[:, 2] = np.abs(at_m[:, 2])
    step_m = 1e-3
    ways = step_m * np.eye(3)
    columns = [dipoles.at(*split(at_m + way)) - dipoles.at(*split(at_m - way)) for way in ways]
    gradient = np.stack(columns, axis=2) / (2 * step_m)
    slack = 1e-4 * np.linalg.norm(gradient, axis=(1, 2))
    assert (np.abs(np.trace(gradient, axis1=1, axis2=2)) < slack).all()
    assert (np.abs(gradient - gradient.transpose(0, 2, 1)).max(axis=(1, 2)) < slack).all()


def split(at_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return at_m[:, :2], at_m[:, 2]


def test_no_place_above_the_floor_meets_more_than_the_surface_of_a_dipole():
    """Even right over it, and however strong it is."""
    for moment_am2 in (1.0, 1e3, 1e6):
        dipoles = drawn(3, moment_am2=moment_am2, log_spread=2.0, per_m2=1 / 400)
        one_by_one = [
            Dipoles(dipoles.centre_m[i : i + 1], dipoles.moment_am2[i : i + 1]).at(
                dipoles.centre_m[i : i + 1, :2], np.zeros(1)
            )
            for i in range(len(dipoles.centre_m))
        ]
        strength_ut = np.linalg.norm(one_by_one, axis=2)
        assert strength_ut.max() <= DipoleParams().surface_ut * (1 + 1e-9)
    touching = drawn(3, cover_m=0.0)
    radius_m = np.cbrt(0.2 * np.linalg.norm(touching.moment_am2, axis=1) / 200.0)
    np.testing.assert_allclose(touching.centre_m[:, 2], -radius_m)


def test_without_dipoles_the_rest_of_the_field_stays_as_it_is():
    at_m = np.column_stack([np.random.default_rng(5).uniform(0, 100, (50, 2)), np.ones(50)])
    none = Sheet(sigma_ut=0.0, at_m=1.0, depth_m=1.0, order=2, num_waves=1)
    fields = [
        draw_field(np.random.default_rng(6), [0.0], [SQUARE], params)
        for params in (
            MagneticParams(),
            MagneticParams(dipoles=DipoleParams(per_m2=0.0)),
            MagneticParams(structure=none, panels=none),
        )
    ]
    both, waves, dipoles = (field.at(at_m) - field.earth_ut for field in fields)
    np.testing.assert_allclose(both, waves + dipoles, atol=1e-9)
    assert np.abs(dipoles).max() > 0.5


@pytest.mark.parametrize("change", [{"per_m2": -1.0}, {"moment_am2": np.nan}, {"surface_ut": 0.0}, {"cover_m": -0.1}])
def test_dipoles_that_are_none_are_refused(change):
    with pytest.raises(MapError, match="magnetic dipoles"):
        replace(DipoleParams(), **change)
