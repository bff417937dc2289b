"""Algorithm 1 to the letter: moments, weights, draws, bins; and the filter of the product against it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.stats import chisquare, norm

from pdrbench.building import Building, FloorRegion
from pdrbench.filters import FilterError
from pdrbench.filters.kld import kld_bound, normal_quantile
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Observation
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.woodman2008.map_filter import WoodmanFilter
from pdrbench_baselines.woodman2008.params import HeadingPrior, WoodmanFilterParams
from pdrbench_lab.papers.woodman2008.literal import LiteralFilter, Woodman2008Literal

NUM_TREADS, TREAD_M, RISER_M = 18, 0.28, 0.17  # of `stairs`
MANY = 20_000
EAST = HeadingPrior(0.0, 0.0)
STILL = WoodmanFilterParams(length_sigma_m=0.0, heading_sigma_rad=0.0, min_particles=MANY)


def spot(polygon: int, x_m: float, y_m: float) -> FloorRegion:
    """A triangle as small as a point."""
    return FloorRegion([[[x_m, y_m], [x_m + 1e-6, y_m], [x_m, y_m + 1e-6]]], [polygon])


def started(
    building: Building, rng: np.random.Generator, polygon: int, x_m: float, y_m: float, **changes: object
) -> LiteralFilter:
    """A filter whose particles all stand at one place and face east."""
    params = dataclasses.replace(WoodmanFilterParams(min_particles=MANY), **changes)  # type: ignore[arg-type]
    made = LiteralFilter(building, rng, params)
    made.start(spot(polygon, x_m, y_m), EAST)
    return made


def test_turns_first_then_walks_with_the_noise_of_each_role(hangar: Building, rng: np.random.Generator) -> None:
    made = started(hangar, rng, 0, 20.0, 20.0)
    made.update(1.3, 0.0, math.pi / 2)
    cloud = made.cloud()
    dx, dy = (cloud.xy_m - 20.0).T
    length_m = dx * np.cos(cloud.heading_rad) + dy * np.sin(cloud.heading_rad)
    across_m = dy * np.cos(cloud.heading_rad) - dx * np.sin(cloud.heading_rad)
    assert np.abs(across_m).max() < 1e-5  # moves along the new heading, eq. (10) and (11)
    standard_error = 1 / math.sqrt(MANY)  # of a mean in sigmas; that of a sigma is 0.7 of it
    assert length_m.mean() == pytest.approx(1.3, abs=4 * 0.15 * standard_error)
    assert length_m.std() == pytest.approx(0.15, rel=4 * standard_error)
    assert cloud.heading_rad.mean() == pytest.approx(math.pi / 2, abs=4 * math.radians(0.6) * standard_error)
    assert cloud.heading_rad.std() == pytest.approx(math.radians(0.6), rel=4 * standard_error)
    assert abs(np.corrcoef(length_m, cloud.heading_rad)[0, 1]) < 4 * standard_error


def test_walls_kill_and_only_walls(stairs: Building, rng: np.random.Generator) -> None:
    made = started(stairs, rng, 0, 5.0, 1.0)  # a metre before the wall beside the flight
    made.update(1.1, 3.0, 0.0)  # a rise that no floor has
    cloud = made.cloud()
    has_no_weight = cloud.weight == 0.0
    beyond = cloud.xy_m[:, 0] > 6.0
    assert (has_no_weight == beyond).all()
    assert has_no_weight.mean() == pytest.approx(norm.cdf(0.1 / 0.15), abs=4 * 0.5 / math.sqrt(MANY))
    assert not made.is_depleted
    made.update(0.0, 300.0, 0.0)  # a rise of which the density underflows
    assert (made.cloud().weight[made.cloud().weight > 0] > 0).sum() > MANY / 3


def test_weight_is_the_density_of_the_height_over_the_whole_stride(stairs: Building, rng: np.random.Generator) -> None:
    made = started(stairs, rng, 0, 5.9, 3.0)
    made.update(1.2, 0.6, 0.0)
    cloud = made.cloud()
    alive = cloud.weight > 0
    treads = np.floor((cloud.xy_m[:, 0] - 6.0) / TREAD_M).astype(int) + 1
    assert (cloud.polygon[alive] == treads[alive]).all()  # several treads in one stride
    expected = np.exp(-0.5 * ((0.6 - treads * RISER_M) / 0.1) ** 2)
    assert cloud.weight[alive] == pytest.approx(expected[alive])
    blind = started(stairs, rng, 0, 5.9, 3.0, height_sigma_m=math.inf)
    blind.update(1.2, 0.6, 0.0)
    assert set(blind.cloud().weight) <= {0.0, 1.0}


def test_draws_by_weight(stairs: Building, rng: np.random.Generator) -> None:
    # One stride spreads particles over treads with known weights; one without noise then copies what is drawn.
    made = started(stairs, rng, 0, 5.9, 3.0, heading_sigma_rad=0.0)
    made.update(1.2, 0.6, 0.0)
    before = made.cloud()
    made._params = STILL
    made.update(0.0, 0.0, 0.0)
    after = made.cloud()
    treads = np.arange(1, NUM_TREADS)
    expected = np.array([before.weight[before.polygon == tread].sum() for tread in treads])
    counted = np.array([(after.polygon == tread).sum() for tread in treads])
    seen = expected * made.num_particles / expected.sum() > 5
    scale = counted[seen].sum() / expected[seen].sum()
    assert chisquare(counted[seen], expected[seen] * scale).pvalue > 1e-3
    assert np.isin(after.xy_m[:, 0], before.xy_m[before.weight > 0, 0]).all()


@pytest.mark.parametrize("live_only", [False, True])
def test_stops_when_the_bins_of_the_propagated_particles_have_enough(
    stairs: Building, rng: np.random.Generator, live_only: bool
) -> None:
    made = LiteralFilter(stairs, rng, WoodmanFilterParams(live_only=live_only, kld_epsilon=0.02))
    made.start(FloorRegion.whole(stairs))
    z = normal_quantile(0.01)
    for stride in ((0.0, 0.0, 0.0), (1.2, 0.0, 0.3), (1.0, 0.4, -2.0)):
        cloud = made.cloud()
        counted = cloud.weight > 0 if live_only else np.ones(len(cloud), dtype=bool)
        height = np.floor(stairs.height(cloud.polygon))
        sector = np.floor(np.mod(cloud.heading_rad, 2 * math.pi) / math.radians(10))
        bins = np.column_stack([np.floor(cloud.xy_m), height, sector])[counted]
        assert made.num_bins == len(np.unique(bins, axis=0))
        assert made.num_particles == len(cloud) == max(kld_bound(made.num_bins, 0.02, z), 32)
        made.update(*stride)


def test_prior_is_uniform_over_area_and_heading(stairs: Building, rng: np.random.Generator) -> None:
    made = LiteralFilter(stairs, rng, WoodmanFilterParams(min_particles=MANY))
    made.start(FloorRegion.whole(stairs))
    cloud = made.cloud()
    areas = np.array([polygon.area_m2 for polygon in stairs.polygons])
    counts = np.bincount(cloud.polygon, minlength=len(areas))
    assert chisquare(counts, len(cloud) * areas / areas.sum()).pvalue > 1e-3
    sectors = np.histogram(cloud.heading_rad, bins=36, range=(-math.pi, math.pi))[0]
    assert chisquare(sectors).pvalue > 1e-3
    assert (stairs.contains(cloud.xy_m, stairs.level(cloud.polygon))).all()


def corridor_start(office: Building) -> FloorRegion:
    floor = FloorRegion.whole(office)
    inside = [i for i, p in enumerate(floor.polygon) if "corridor" in office.polygons[p].id]
    return FloorRegion(floor.corners_xy_m[inside[:1]], floor.polygon[inside[:1]])


def posterior(kind: type, office: Building, seed: int) -> FloatArray:
    particles = kind(office, np.random.default_rng(seed))
    particles.start(corridor_start(office), HeadingPrior(0.0, 0.3))
    for _ in range(3):
        particles.update(1.1, 0.0, 0.02)
    cloud = particles.cloud()
    weight = cloud.weight / cloud.weight.sum()
    mean = weight @ cloud.xy_m
    spread = weight @ (cloud.xy_m - mean) ** 2
    alive = (cloud.weight > 0).mean()
    return np.array([*mean, *spread, alive, weight @ cloud.heading_rad, particles.num_particles])


def test_agrees_with_the_literal_filter_in_distribution(office: Building) -> None:
    """Posterior means over 300 runs each agree to within four standard errors; the systematic draw spreads no more.

    The number of particles may differ by some per cent: systematic resampling keeps more distinct ancestors,
    which fills a few more bins.
    """
    fast = np.array([posterior(WoodmanFilter, office, seed) for seed in range(300)])
    literal = np.array([posterior(LiteralFilter, office, seed) for seed in range(1000, 1300)])
    error = np.sqrt((fast.var(axis=0) + literal.var(axis=0)) / 300)
    apart = np.abs(fast.mean(axis=0) - literal.mean(axis=0)) / error
    assert apart[:6].max() < 4
    assert (fast.std(axis=0) < 1.15 * literal.std(axis=0)).all()
    assert fast[:, 6].mean() == pytest.approx(literal[:, 6].mean(), rel=0.08)


def test_a_cap_and_the_depletion_of_all_particles(stairs: Building, rng: np.random.Generator) -> None:
    made = LiteralFilter(stairs, rng, WoodmanFilterParams(max_particles=5000))
    made.start(FloorRegion.whole(stairs))
    assert made.num_particles == 5000
    made.update(100.0, 0.0, 0.0)
    assert made.is_depleted
    with pytest.raises(FilterError, match="no particle is alive"):
        made.update(1.0, 0.0, 0.0)


def test_the_localizer_tracks_a_given_start(hangar: Building, rng: np.random.Generator) -> None:
    localizer = Woodman2008Literal()
    sensors = {"stride": sensor_spec("stride")}
    localizer.reset(Briefing(hangar, sensors, 0.2, Start(np.array([5.0, 5.0]), 0, 0.0)), rng)
    for _ in range(10):
        estimate = localizer.step(Observation(0.0, {"stride": np.array([[0.0, 1.0, 0.0, 0.0]])}))
    assert estimate.converged
    assert estimate.xy_m == pytest.approx([15.0, 5.0], abs=4 * 0.5)  # ten strides of 0.15 m noise


def test_unsupported_options_are_errors(stairs: Building, rng: np.random.Generator) -> None:
    with pytest.raises(FilterError, match="call start"):
        LiteralFilter(stairs, rng).update(1.0, 0.0, 0.0)
    with pytest.raises(FilterError, match="larger"):
        LiteralFilter(stairs, rng, WoodmanFilterParams(bin_m=1e-4))
    with pytest.raises(FilterError, match="covers no floor"):
        LiteralFilter(stairs, rng).start(FloorRegion(np.zeros((0, 3, 2)), np.zeros(0, dtype=np.int64)))
