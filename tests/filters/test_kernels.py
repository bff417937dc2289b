"""Random numbers, the map walk in float32, resampling and the KLD bound, each against a slow or exact reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit
from scipy import stats
from scipy.stats import chi2

from pdrbench.building import Building, FloorPolygon, FloorRegion
from pdrbench.building.convex import compile_map
from pdrbench.filters import map_walk, resampling
from pdrbench.filters.kld import kld_bound, normal_quantile
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_baselines.woodman2008.random_numbers import box_muller, philox


def slow_philox(counter: tuple[int, int, int, int], key: tuple[int, int]) -> list[int]:
    """Philox4x32-10 as its authors write it (Salmon et al. 2011)."""
    c, k = list(counter), list(key)
    for _ in range(10):
        p0, p1 = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
        c = [(p1 >> 32) ^ c[1] ^ k[0], p1 & 0xFFFFFFFF, (p0 >> 32) ^ c[3] ^ k[1], p0 & 0xFFFFFFFF]
        k = [(k[0] + 0x9E3779B9) & 0xFFFFFFFF, (k[1] + 0xBB67AE85) & 0xFFFFFFFF]
    return c


def test_the_reference_philox_gives_the_published_words_and_normals_follow_the_law() -> None:
    """Known answers that come with Random123."""
    assert slow_philox((0, 0, 0, 0), (0, 0)) == [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]
    ones = 0xFFFFFFFF
    assert slow_philox((ones,) * 4, (ones, ones)) == [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]
    # Every one as float64 gives it; and as a whole normal: p of Kolmogorov and Smirnov's test with this seed.
    normals = draw_normals(200_000)
    assert stats.kstest(normals, "norm").pvalue > 0.01


@pytest.mark.parametrize("first", [0, 2**32 - 3])
def test_compiled_philox(first: int) -> None:
    words = np.zeros((4, 8), np.uint32)
    keys = np.array([0xDEADBEEF, 0x12345678, 5], np.uint64)
    philox(np.uint64(first), np.uint64(2), keys, *words)
    for i in range(8):
        count = first + i
        assert words[:, i].tolist() == slow_philox((count & 0xFFFFFFFF, count >> 32, 5, 2), (0xDEADBEEF, 0x12345678))


def draw_normals(count: int) -> FloatArray:
    rng = np.random.default_rng(0)
    words = rng.integers(2**32, size=(2, count), dtype=np.uint32)
    unit = np.empty(count, np.float32)
    a, b = np.empty((2, count), np.float32)
    box_muller(words[0], words[1], unit, unit.view(np.int32), a, b)
    u = (words[0] >> 8).astype(np.float64) * 2.0**-24 + 2.0**-25
    v = (words[1] >> 8).astype(np.float64) * 2.0**-24 + 2.0**-25 - 0.5
    radius = np.sqrt(-2 * np.log(u))
    # near 1 a float32 holds the word to 3e-8 only, and the radius, which is small there, to its square root's slope
    np.testing.assert_allclose(a, radius * np.cos(2 * np.pi * v), atol=5e-5)
    np.testing.assert_allclose(b, radius * np.sin(2 * np.pi * v), atol=5e-5)
    return np.concatenate([a, b]).astype(np.float64)


def test_exp_is_exact_to_double_precision() -> None:
    for a in np.linspace(0, map_walk.MAX_EXPONENT, 1001):
        assert map_walk.exp_minus(float(a)) == pytest.approx(math.exp(-a), rel=1e-12)


# The walk.


def turned(building: Building, angle_rad: float) -> Building:
    rotation = np.array([[np.cos(angle_rad), np.sin(angle_rad)], [-np.sin(angle_rad), np.cos(angle_rad)]])
    return Building(
        building.name,
        tuple(
            FloorPolygon(
                p.id,
                p.outline_xy_m @ rotation,
                p.neighbour,
                p.height_m,
                p.level,
                p.kind,
                tuple(hole @ rotation for hole in p.holes),
            )
            for p in building.polygons
        ),
    )


def draw(building: Building, rng: np.random.Generator, count: int) -> tuple[IntArray, FloatArray]:
    """Cells and local places, sorted by cell."""
    convex = compile_map(building)
    corners, cell = convex.cells_of(FloorRegion.whole(building))
    sides = np.diff(corners.astype(np.float64), axis=1)
    area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    triangle = np.sort(rng.choice(len(area), count, p=area / area.sum()))
    barycentric = rng.dirichlet(np.ones(3), count)
    return cell[triangle], np.einsum("nk,nkc->nc", barycentric, corners[triangle]).astype(np.float32)


def walk(building: Building, cell: IntArray, start: FloatArray, end: FloatArray) -> tuple[IntArray, BoolArray]:
    reached, weight = cell.astype(np.int32), np.empty(len(cell), np.float32)
    x, y, xe, ye = (np.ascontiguousarray(v, np.float32) for v in (*start.T, *end.T))
    map_walk.walk_sorted(compile_map(building).world, x, y, xe, ye, reached, weight)
    return reached, weight > 0


@pytest.mark.parametrize("angle_rad", [0.0, 0.7])
def test_walks_as_the_simple_kernel_does(office: Building, rng: np.random.Generator, angle_rad: float) -> None:
    """float32 rounds by 4e-6 m here: about 1e-5 of the ways pass a corner so closely that the two may differ."""
    building = turned(office, angle_rad)
    convex = compile_map(building)
    cell, start = draw(building, rng, 300_000)
    end = (start + rng.normal(0, 1.0, start.shape)).astype(np.float32)
    reached, alive = walk(building, cell, start, end)
    origin = convex.origin_xy_m
    oracle, survives = building.move(convex.polygon[cell], start + origin, end + origin)
    assert (alive != survives).mean() < 1e-4
    both = alive & survives
    assert (convex.polygon[reached[both]] != oracle[both]).mean() < 1e-4
    assert 0.3 < alive.mean() < 0.95


def check_no_leaks(building: Building, rng: np.random.Generator, steps: int, count: int) -> None:
    """Walks on and on, half of the steps aimed at or beyond vertices; live particles replace those that hit a wall."""
    convex = compile_map(building)
    corners = convex.corner_xy_m.astype(np.float32)
    cell, start = draw(building, rng, count)
    for _ in range(steps):
        at = convex.first_corner[cell] + rng.integers(0, np.diff(convex.first_corner)[cell])
        beyond = rng.choice(np.float32([0.9, 1.0, 1.3, 3.0]), (count, 1))
        free = start + rng.standard_normal((count, 2), dtype=np.float32)
        end = np.where(rng.random((count, 1)) < 0.5, start + (corners[at] - start) * beyond, free)
        reached, alive = walk(building, cell, start, end)
        reached, end = reached[alive].astype(np.int64), end[alive]
        assert len(reached) > count / 10
        assert convex.outside_m(reached, end).max() < convex.tolerance_m
        chosen = rng.integers(len(reached), size=count)
        chosen = chosen[np.argsort(reached[chosen], kind="stable")]
        cell, start = reached[chosen], end[chosen]


@pytest.mark.parametrize("angle_rad", [0.0, 0.7])
def test_no_particle_leaves_the_floor(office: Building, rng: np.random.Generator, angle_rad: float) -> None:
    check_no_leaks(turned(office, angle_rad), rng, steps=5, count=200_000)


def test_a_stride_over_many_treads(rng: np.random.Generator) -> None:
    """Ten treads of 0.3 m in one stride of 2.9 m: the last is reached, and the weight is that of its height."""
    treads = tuple(
        FloorPolygon(
            f"tread-{i}",
            [[0.3 * i, 0], [0.3 * (i + 1), 0], [0.3 * (i + 1), 1], [0.3 * i, 1]],
            [-1, i + 1 if i < 9 else -1, -1, i - 1 if i else -1],
            0.17 * i,
            0,
            "stairs",
        )
        for i in range(10)
    )
    building = Building("stair", treads)
    reached, alive = walk(building, np.array([0]), np.array([[-1.4, 0.0]]), np.array([[1.49, 0.1]]))
    assert alive[0]
    assert compile_map(building).polygon[reached[0]] == 9


# Resampling.


def test_systematic_and_multinomial_draw_by_weight(rng: np.random.Generator) -> None:
    """Systematic: N w copies, rounded up or down. Multinomial: the particle at which the running sum passes a draw."""
    weight = np.array([0.0, 1.0, 0.0, 5.0, 2.0, 0.0])
    copies = np.bincount(resampling.systematic(weight, rng.random()), minlength=6)
    assert copies.sum() == 6
    assert (np.abs(copies - 6 * weight / 8) < 1).all()
    assert resampling.multinomial(weight, np.array([0.0, 0.124, 0.126, 0.74, 0.76, 0.999])).tolist() == [
        1,
        1,
        3,
        3,
        4,
        4,
    ]


@pytest.mark.parametrize("epsilon", [0.01, 0.15])
@pytest.mark.parametrize("delta", [0.001, 0.05])
def test_is_the_chi_square_quantile(epsilon: float, delta: float) -> None:
    # n = chi2(k - 1, 1 - delta) / (2 epsilon), Fox 2001. Wilson and Hilferty's approximation is off by 6 % at one
    # degree of freedom and this smallest delta, by 2 % at three, and by ever less; rounding up adds one at most.
    num_bins = np.array([2, 4, 8, 31, 1000, 452_000])
    off_by = np.array([0.06, 0.02, 0.02, 0.005, 0.005, 0.005])
    ours = np.array([kld_bound(int(k), epsilon, normal_quantile(delta)) for k in num_bins])
    exact = chi2.ppf(1 - delta, num_bins - 1) / (2 * epsilon)
    assert (np.abs(ours - exact) <= off_by * exact + 1).all()


def test_paper_counts() -> None:
    # sources.md note 2: 170 particles on average are 8 bins, 500 at most 31; 4.53 million are 1.44 bins on a m2
    z = normal_quantile(0.01)
    assert kld_bound(8, 0.05, z) == pytest.approx(170, rel=0.1)
    assert kld_bound(31, 0.05, z) == pytest.approx(500, rel=0.03)
    assert kld_bound(round(8725 * 1.44 * 36), 0.05, z) == pytest.approx(4_530_000, rel=0.01)


@pytest.mark.parametrize("num_bins", [0, 1])
def test_one_bin_needs_one_particle(num_bins: int) -> None:
    assert kld_bound(num_bins, 0.05, 2.33) == 1


def test_the_bound_never_decreases_and_is_the_same_compiled() -> None:
    assert kld_bound(2, 1e9, -3.0) == 1  # an epsilon and a delta that ask for nothing
    bounds = [kld_bound(k, 0.05, 2.33) for k in range(500)]
    assert (np.diff(bounds) >= 0).all()
    compiled = njit(kld_bound)
    for num_bins in (*range(50), 12_345, 9_999_999):
        assert compiled(num_bins, 0.05, 2.3263478740408408) == kld_bound(num_bins, 0.05, 2.3263478740408408)
