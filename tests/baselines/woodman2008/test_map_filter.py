"""Priors, strides and generations of the filter; tests of the laboratory have it against the literal one."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import numpy as np
import pytest
from numba import njit
from scipy import stats

from pdrbench.building import Building, FloorPolygon, FloorRegion
from pdrbench.building.convex import compile_map
from pdrbench.filters import FilterError
from pdrbench.filters.kld import kld_bound, normal_quantile
from pdrbench.filters.map_walk import TILE, new_scratch, walk_tile
from pdrbench_baselines.woodman2008.generation import Tile, _walk_by_cell
from pdrbench_baselines.woodman2008.map_filter import FULL_TURN_RAD, WoodmanFilter, motion_of
from pdrbench_baselines.woodman2008.params import HeadingPrior, WoodmanFilterParams

W = -1


def square(side_m: float = 40.0) -> Building:
    outline = [[0, 0], [side_m, 0], [side_m, side_m], [0, side_m]]
    return Building("square", (FloorPolygon("floor", outline, [W, W, W, W], 0.0, 0),))


def patch(x_m: float, y_m: float, side_m: float = 1.0) -> FloorRegion:
    a, b, c, d = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * side_m + [x_m, y_m]
    return FloorRegion(np.array([[a, b, c], [a, c, d]]), np.array([0, 0]))


def corridor_start(office: Building) -> FloorRegion:
    floor = FloorRegion.whole(office)
    inside = [i for i, p in enumerate(floor.polygon) if "corridor" in office.polygons[p].id]
    return FloorRegion(floor.corners_xy_m[inside[:1]], floor.polygon[inside[:1]])


def test_the_prior_fills_floor_and_headings(rng: np.random.Generator) -> None:
    """Even over 40 x 40 m and all headings: 36 * 1600 bins, each hit by about 10 particles, and the bound for them."""
    particles = WoodmanFilter(square(), rng)
    particles.start(FloorRegion.whole(square()))
    assert particles.num_bins == pytest.approx(36 * 1600, abs=5)
    assert particles.num_particles - particles.overshoot == kld_bound(particles.num_bins, 0.05, normal_quantile(0.01))
    assert particles.overshoot <= particles.num_particles / 64
    cloud = particles.cloud()
    for values, low, width in (
        (cloud.xy_m[:, 0], 0.0, 40.0),
        (cloud.xy_m[:, 1], 0.0, 40.0),
        (cloud.heading_rad, -np.pi, 2 * np.pi),
    ):
        assert stats.kstest(values[::50], "uniform", (low, width)).pvalue > 0.01
    assert (cloud.weight == 1).all()


def test_a_known_heading_divides_the_prior_by_36(rng: np.random.Generator) -> None:
    """Claim W18: headings within one bin of 10 degrees need exactly 1/36 of the bins."""
    wide, narrow = WoodmanFilter(square(), rng), WoodmanFilter(square(), rng)
    wide.start(FloorRegion.whole(square()))
    narrow.start(FloorRegion.whole(square()), HeadingPrior(np.radians(25), np.radians(4.99)))
    assert narrow.num_bins == pytest.approx(wide.num_bins / 36, rel=1e-3)
    heading_deg = np.degrees(narrow.cloud().heading_rad)
    assert heading_deg.min() >= 20
    assert heading_deg.max() <= 30


def test_one_stride_has_the_moments_of_the_motion_model(rng: np.random.Generator) -> None:
    """In free space: mean l cos(theta) exp(-sigma^2 / 2), variances from eq. (7) to (11) and the start."""
    params = WoodmanFilterParams(heading_sigma_rad=0.05, min_particles=200_000)
    particles = WoodmanFilter(square(), rng, params)
    particles.start(patch(19.5, 19.5), HeadingPrior(0.5, 1e-9))
    particles.update(1.3, 0.0, 0.25)
    cloud = particles.cloud()
    assert len(cloud) >= 200_000
    mean = 20 + 1.3 * np.exp(-(0.05**2) / 2) * np.array([np.cos(0.75), np.sin(0.75)])
    tolerance = 5 * np.sqrt((1 / 12 + 0.15**2) / len(cloud))
    np.testing.assert_allclose(cloud.xy_m.mean(axis=0), mean, atol=tolerance)
    along = cloud.xy_m @ [np.cos(0.75), np.sin(0.75)]
    across = cloud.xy_m @ [-np.sin(0.75), np.cos(0.75)]
    # a square patch has variance 1/12 in every direction
    assert along.var() == pytest.approx(1 / 12 + 0.15**2, rel=0.02)
    assert across.var() == pytest.approx(1 / 12 + (1.3 * 0.05) ** 2, rel=0.02)
    assert cloud.heading_rad.std() == pytest.approx(0.05, rel=0.02)
    assert cloud.heading_rad.mean() == pytest.approx(0.75, abs=1e-3)


def test_backward_and_zero_strides_are_walked_and_clipped_lengths_never_step_back(rng: np.random.Generator) -> None:
    particles = WoodmanFilter(square(), rng, WoodmanFilterParams(min_particles=5000))
    particles.start(patch(20, 20), HeadingPrior(0.0, 1e-9))
    particles.update(-1.0, 0.0, 0.0)
    assert particles.cloud().xy_m[:, 0].mean() == pytest.approx(19.5, abs=0.1)
    particles.update(0.0, 0.0, 0.0)
    assert particles.cloud().xy_m[:, 0].mean() == pytest.approx(19.5, abs=0.15)
    particles = WoodmanFilter(square(), rng, WoodmanFilterParams(clip_length=True, heading_sigma_rad=0.0))
    particles.start(patch(20, 20, 1e-3), HeadingPrior(0.0, 1e-9))
    particles.update(0.0, 0.0, 0.0)
    assert particles.cloud().xy_m[:, 0].min() >= 20 - 1e-4


def stairs() -> Building:
    """Floor, and a tread 0.17 m above it, behind an edge that all cross."""
    return Building(
        "step",
        (
            FloorPolygon("low", [[0, 0], [10, 0], [10, 10], [0, 10]], [W, 1, W, W], 0.0, 0),
            FloorPolygon("high", [[10, 0], [20, 0], [20, 10], [10, 10]], [W, W, W, 0], 0.17, 0),
        ),
    )


def test_the_weight_of_a_height(rng: np.random.Generator) -> None:
    """Eq. (16) without its factor: exp(-(dz - dz_poly)^2 / (2 sigma^2)), both with and without a climb."""
    region = FloorRegion(np.array([[[9.0, 4.0], [9.9, 4.0], [9.9, 6.0]]]), np.array([0]))
    particles = WoodmanFilter(stairs(), rng)
    particles.start(region, HeadingPrior(0.0, 1e-9))
    particles.update(0.5, 0.20, 0.0)
    cloud = particles.cloud()
    climbed = cloud.polygon == 1
    assert 0.2 < climbed.mean() < 0.9
    np.testing.assert_allclose(cloud.weight[climbed], np.exp(-(0.03**2) / 0.02), rtol=1e-5)
    np.testing.assert_allclose(cloud.weight[~climbed], np.exp(-(0.20**2) / 0.02), rtol=1e-5)


def test_without_heights_or_with_unexplained_ones_only_walls_count(rng: np.random.Generator) -> None:
    particles = WoodmanFilter(stairs(), rng, WoodmanFilterParams(height_sigma_m=np.inf))
    particles.start(FloorRegion.whole(stairs()))
    particles.update(0.5, 2.0, 0.0)
    assert set(particles.cloud().weight) == {0.0, 1.0}
    particles = WoodmanFilter(square(), rng)
    particles.start(patch(20, 20))
    particles.update(0.5, 3.0, 0.0)
    assert not particles.is_depleted
    particles.update(0.5, 0.0, 0.0)


def test_the_depletion_of_all_particles_is_reported(rng: np.random.Generator) -> None:
    particles = WoodmanFilter(square(10.0), rng)
    particles.start(patch(4, 4), HeadingPrior(0.0, 0.1))
    particles.update(30.0, 0.0, 0.0)
    assert particles.is_depleted
    with pytest.raises(FilterError, match="no particle is alive"):
        particles.update(1.0, 0.0, 0.0)
    particles.start(patch(4, 4))
    assert not particles.is_depleted


@pytest.mark.parametrize("stride", [(np.nan, 0, 0), (1, np.inf, 0), (1, 0, -np.inf)])
def test_strides_that_are_not_finite(rng: np.random.Generator, stride: tuple[float, float, float]) -> None:
    particles = WoodmanFilter(square(), rng)
    particles.start(patch(20, 20))
    with pytest.raises(FilterError, match="finite"):
        particles.update(*stride)


def test_a_region_without_floor_and_a_cap_on_particles(rng: np.random.Generator) -> None:
    with pytest.raises(FilterError, match="covers no floor"):
        WoodmanFilter(square(), rng).start(FloorRegion(np.zeros((0, 3, 2)), np.zeros(0)))
    with pytest.raises(FilterError, match="covers no floor"):
        WoodmanFilter(square(), rng).start(patch(100, 100))
    particles = WoodmanFilter(square(), rng, WoodmanFilterParams(max_particles=5000))
    particles.start(FloorRegion.whole(square()))
    assert particles.num_particles == 5000
    particles.update(1.0, 0.0, 0.0)
    assert particles.num_particles == 5000


def test_live_only_needs_fewer_particles(office: Building) -> None:
    counts = []
    for live_only in (False, True):
        particles = WoodmanFilter(office, np.random.default_rng(1), WoodmanFilterParams(live_only=live_only))
        particles.start(FloorRegion.whole(office))
        particles.update(1.2, 0.0, 0.0)
        counts.append(particles.num_bins)
    assert counts[1] < 0.98 * counts[0]


def test_thinned_clouds(rng: np.random.Generator) -> None:
    particles = WoodmanFilter(square(), rng)
    particles.start(FloorRegion.whole(square()))
    assert len(particles.cloud(most=1000)) <= 1000
    assert len(particles.cloud()) == particles.num_particles


def test_memory(rng: np.random.Generator) -> None:
    """Both generations together: 40 bytes a particle, plus the overshoot of batches."""
    particles = WoodmanFilter(square(80.0), rng)
    particles.start(FloorRegion.whole(square(80.0)))
    particles.update(0.5, 0.0, 0.0)
    assert particles.nbytes / particles.num_particles <= 41


_HASH = """
import hashlib, numpy as np
from pdrbench.building import FloorRegion
from pdrbench_baselines.woodman2008.map_filter import WoodmanFilter
from pdrbench_sim.buildings.office import make_office
office = make_office(np.random.default_rng(7), num_levels=1, area_m2=500.0)
particles = WoodmanFilter(office, np.random.default_rng(5))
particles.start(FloorRegion.whole(office))
digest = hashlib.sha256()
for i in range(4):
    particles.update(1.2, 0.0, 0.1)
    cloud = particles.cloud()
    for values in (cloud.xy_m, cloud.heading_rad, cloud.polygon, cloud.weight):
        digest.update(values.tobytes())
print(digest.hexdigest())
"""


def _hash(threads: int) -> str:
    environ = os.environ | {"NUMBA_NUM_THREADS": str(threads)}
    done = subprocess.run([sys.executable, "-c", _HASH], env=environ, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def test_same_bytes_whatever_the_number_of_threads() -> None:
    digests = {_hash(threads) for threads in (1, 3)}
    assert len(digests) == 1
    assert len(digests.pop()) == len(hashlib.sha256().hexdigest())


def test_what_is_handed_over_once_is_that_of_every_stride(office: Building, rng: np.random.Generator) -> None:
    """The same bytes as handed over anew for each stride, with starts, many particles and settings in between."""
    kept, anew = (WoodmanFilter(office, np.random.default_rng(5)) for _ in range(2))
    for number in range(44):
        stride = float(rng.uniform(0.2, 1.4)), 0.0, float(rng.normal(0.0, 0.3))
        anew._few = None
        for particles in (kept, anew):
            if number in (0, 20) or particles.is_depleted:
                particles.start(corridor_start(office), HeadingPrior(0.0, 0.3))
            if number == 40:
                particles.start(FloorRegion.whole(office))
            if number in (10, 30):
                particles.adjust(WoodmanFilterParams(live_only=number == 10, kld_epsilon=0.02))
            particles.update(*stride)
        assert kept.num_particles == anew.num_particles
        for values, others in zip(kept._now, anew._now, strict=True):
            assert values[..., : kept.num_particles].tobytes() == others[..., : kept.num_particles].tobytes()


@pytest.mark.parametrize("count", [1, 170, TILE])
def test_particles_in_any_order_are_walked_as_they_stand(
    office: Building, rng: np.random.Generator, count: int
) -> None:
    """Sorted by cell or not: the same bytes, in a crowd in which hardly two neighbours stand in the same cell."""
    crowd = WoodmanFilter(office, rng)
    crowd.start(FloorRegion.whole(office))
    chosen = rng.permutation(crowd.num_particles)[:count]
    x, y, turns, weight = (row[chosen] for row in crowd._now.state)
    cell, convex = crowd._now.cell[chosen], compile_map(office)
    x_end, y_end = (at + rng.normal(0.0, 1.5, count).astype(np.float32) for at in (x, y))
    motion = motion_of(WoodmanFilterParams(), (0.0, 0.2, 0.0), np.float32, FULL_TURN_RAD)
    plain = Tile(x_end.copy(), y_end.copy(), turns, weight.copy(), cell.copy())
    moved = *plain[:2], plain.cell, plain.weight, new_scratch()
    njit(lambda given: walk_tile(*given))((convex.world, motion.rise, motion.rise_sigma, x, y, *moved))
    tile, slot = Tile(x_end, y_end, turns, weight, cell), np.zeros(len(convex), np.int32)
    njit(lambda given: _walk_by_cell(*given))((convex.world, motion, x, y, tile, slot, new_scratch()))
    assert [values.tobytes() for values in tile] == [values.tobytes() for values in plain]
    assert not slot.any()
