"""The filter on a GPU, against the processor's. NUMBA_ENABLE_CUDASIM=1 runs it in Numba's simulator, in minutes."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numba import config

from pdrbench.building import Building, FloorRegion
from pdrbench.errors import UnsuitableError
from pdrbench.filters import FilterError
from pdrbench.filters.warm import two_rooms
from pdrbench.geometry import FloatArray
from pdrbench.gym.checking import by_episode
from pdrbench.localizer import Briefing
from pdrbench.registry import make_task
from pdrbench_baselines.woodman2008.localizer import Woodman2008
from pdrbench_baselines.woodman2008.map_filter import WoodmanFilter
from pdrbench_baselines.woodman2008.params import HeadingPrior, ParticleCloud, WoodmanFilterParams
from pdrbench_lab.papers.woodman2008 import gpu_localizer
from pdrbench_lab.papers.woodman2008.gpu_localizer import Woodman2008Gpu, why_no_gpu
from pdrbench_lab.papers.woodman2008.literal import LiteralFilter

if TYPE_CHECKING:
    from pdrbench_lab.papers.woodman2008.gpu_filter import GpuFilters

IS_SIMULATED = bool(config.ENABLE_CUDASIM)
runs_kernels = pytest.mark.skipif(why_no_gpu() != "", reason=why_no_gpu() or "-")
needs_gpu = pytest.mark.skipif(IS_SIMULATED or why_no_gpu() != "", reason=why_no_gpu() or "the simulator is too slow")
THREADS = 4 if IS_SIMULATED else 64
COARSE = WoodmanFilterParams(kld_epsilon=0.4, min_particles=8)  # clouds of some ten particles
FOOT = FloorRegion(np.array([[[5.0, 2.5], [5.9, 2.5], [5.9, 3.5]]]), np.array([0]))  # of the stairs
AHEAD = HeadingPrior(0.0, 0.3)
STRIDES = [(0.7, 0.0, 0.2), (1.1, 0.17, -0.3), (-0.2, 0.1, 0.0)]


def filters(building: Building, seeds: list[int], params: WoodmanFilterParams, threads: int = THREADS) -> GpuFilters:
    from pdrbench_lab.papers.woodman2008.gpu_filter import GpuFilters

    return GpuFilters(building, [np.random.default_rng(seed) for seed in seeds], params, threads)


def assert_same(on_gpu: GpuFilters, walk: int, there: WoodmanFilter, tolerance: float = 2e-6, most: int = 0) -> None:
    """Particle by particle, in the order of the draw; but for `most` of them to float32 rounding.

    Coordinates below 64 m have roundings of at most 4e-6 m.
    """
    (state, cell), now = on_gpu.particles(walk), there._now
    assert len(cell) == there.num_particles
    apart = np.abs(state - now.state[:, : len(cell)]).max(axis=0) > tolerance
    assert (apart | (cell != now.cell[: len(cell)])).sum() <= most


@runs_kernels
def test_every_particle_is_that_of_the_processor(stairs: Building) -> None:
    """The prior, and generations of some batches each: treads give weights between 0 and 1, walls 0."""
    for building, region, seed in ((stairs, FOOT, 1), (two_rooms(), FloorRegion.whole(two_rooms()), 2)):
        on_gpu, there = filters(building, [seed], COARSE), WoodmanFilter(building, np.random.default_rng(seed), COARSE)
        on_gpu.start(region, AHEAD)
        there.start(region, AHEAD)
        assert_same(on_gpu, 0, there)
        for stride in STRIDES:
            on_gpu.update(np.array([stride]))
            there.update(*stride)
            assert_same(on_gpu, 0, there)
            assert (on_gpu.num_bins[0], on_gpu.overshoot[0]) == (there.num_bins, there.overshoot)
            assert on_gpu.num_live[0] == (there.cloud().weight > 0).sum() > 0
        cloud, expected = on_gpu.cloud(0, 10), there.cloud(10)
        np.testing.assert_allclose(cloud.xy_m, expected.xy_m, atol=1e-5)
        np.testing.assert_array_equal(cloud.polygon, expected.polygon)


@runs_kernels
def test_particles_that_are_moved_where_they_are(stairs: Building) -> None:
    on_gpu, there = filters(stairs, [3], COARSE), WoodmanFilter(stairs, np.random.default_rng(3), COARSE)
    for particles in (on_gpu, there):
        particles.start(FOOT, AHEAD)
    on_gpu.propagate(np.array([STRIDES[1]]))
    there.propagate(*STRIDES[1])
    assert_same(on_gpu, 0, there)
    assert on_gpu.num_bins[0] == there.num_bins


@runs_kernels
def test_walks_at_once_are_those_alone_whatever_the_blocks(stairs: Building) -> None:
    """Walk 1 rests in the second stride, and walk 0 begins anew."""
    both, alone = filters(stairs, [5, 6], COARSE), [filters(stairs, [seed], COARSE, 2 * THREADS) for seed in (5, 6)]
    both.start(FOOT, AHEAD)
    both.update(np.array(STRIDES[:2]))
    both.update(np.array([STRIDES[2], [np.nan] * 3]), np.array([True, False]))
    both.start(FOOT, AHEAD, np.array([True, False]))
    for walk, particles in enumerate(alone):
        particles.start(FOOT, AHEAD)
        particles.update(np.array([STRIDES[walk]]))
    alone[0].update(np.array([STRIDES[2]]))
    alone[0].start(FOOT, AHEAD)
    for walk, particles in enumerate(alone):
        for ours, theirs in zip(both.particles(walk), particles.particles(0), strict=True):
            assert ours.tobytes() == theirs.tobytes()
        assert both.num_bins[walk] == particles.num_bins[0]


@runs_kernels
def test_what_cannot_be_done(stairs: Building) -> None:
    particles = filters(stairs, [1], COARSE)
    particles.start(FOOT, AHEAD)
    with pytest.raises(FilterError, match="finite"):
        particles.update(np.array([[np.nan, 0.0, 0.0]]))
    with pytest.raises(FilterError, match="keeps its bins"):
        particles.adjust(WoodmanFilterParams(bin_m=2.0))
    particles.update(np.array([[90.0, 0.0, 0.0]]))
    assert not particles.num_live.any()
    with pytest.raises(FilterError, match="no particle is alive"):
        particles.update(np.array([[1.0, 0.0, 0.0]]))


def test_without_a_gpu_it_declines(monkeypatch: pytest.MonkeyPatch, stairs: Building) -> None:
    monkeypatch.setattr(gpu_localizer, "why_no_gpu", lambda: "no GPU: buy one")
    with pytest.raises(UnsuitableError, match="buy one"):
        Woodman2008Gpu().reset(Briefing(stairs, {}, 0.2), np.random.default_rng(0))


@needs_gpu
def test_half_a_million_particles_are_those_of_the_processor(office: Building) -> None:
    """A prior of one batch is sorted by cell, so that the processor keeps the order of the draw.

    A place that rounds to the other side of a wall, of a portal or between two draws differs: some in a million.
    """
    params = WoodmanFilterParams(min_particles=500_000, max_particles=500_000)
    on_gpu, there = filters(office, [7], params), WoodmanFilter(office, np.random.default_rng(7), params)
    for particles in (on_gpu, there):
        particles.start(FloorRegion.whole(office))
    assert_same(on_gpu, 0, there, 1e-5, most=10)
    on_gpu.update(np.array([[1.2, 0.0, 0.05]]))
    there.update(1.2, 0.0, 0.05)
    assert_same(on_gpu, 0, there, 1e-5, most=50)
    assert on_gpu.num_bins[0] == pytest.approx(there.num_bins, abs=5)


@needs_gpu
def test_same_bytes_again_and_whatever_the_blocks(office: Building) -> None:
    digests = set()
    for threads in (256, 256, 64):
        particles = filters(office, [5], WoodmanFilterParams(), threads)
        particles.start(FloorRegion.whole(office))
        digest = hashlib.sha256()
        for _ in range(8):
            particles.update(np.array([[1.2, 0.0, 0.1]]))
            for array in particles.particles(0):
                digest.update(array.tobytes())
        digests.add(digest.hexdigest())
    assert len(digests) == 1


def moments(cloud: ParticleCloud) -> list[float]:
    weight = cloud.weight / cloud.weight.sum()
    mean = weight @ cloud.xy_m
    spread = weight @ (cloud.xy_m - mean) ** 2
    return [*mean, *spread, (cloud.weight > 0).mean(), weight @ cloud.heading_rad, len(cloud)]


@needs_gpu
@pytest.mark.parametrize("kind", [WoodmanFilter, LiteralFilter])
def test_agrees_in_distribution(office: Building, kind: type) -> None:
    """Posterior means over 300 runs each agree to within four standard errors (W9), as of the processor's filters."""
    floor = FloorRegion.whole(office)
    (first, *_) = (i for i, p in enumerate(floor.polygon) if "corridor" in office.polygons[p].id)
    region = FloorRegion(floor.corners_xy_m[first : first + 1], floor.polygon[first : first + 1])
    params = WoodmanFilterParams()
    on_gpu = filters(office, list(range(300)), params)
    on_gpu.start(region, AHEAD)
    for _ in range(3):
        on_gpu.update(np.tile([1.1, 0.0, 0.02], (300, 1)))
    found = np.array([moments(on_gpu.cloud(walk)) for walk in range(300)])
    there = []
    for seed in range(1000, 1300):
        particles = kind(office, np.random.default_rng(seed), params)
        particles.start(region, AHEAD)
        for _ in range(3):
            particles.update(1.1, 0.0, 0.02)
        there.append(moments(particles.cloud()))
    expected: FloatArray = np.array(there)
    error = np.sqrt((found.var(axis=0) + expected.var(axis=0)) / 300)
    apart = np.abs(found.mean(axis=0) - expected.mean(axis=0)) / error
    assert apart[:6].max() < 4
    assert (found.std(axis=0) < 1.15 * expected.std(axis=0)).all()
    assert found[:, 6].mean() == pytest.approx(expected[:, 6].mean(), rel=0.08)


@needs_gpu
def test_a_walk_is_answered_as_on_the_processor() -> None:
    """From a known start a cloud is small, and its particles are those of the processor, until rounding decides.

    Which side of a wall or of a bin a particle is on, or how many are in a batch: from then on other particles are
    drawn. On an H100 that was after 18.8 s. Mean errors of several seeds have a standard deviation of about 0.03 m.
    """
    task = make_task("CampusStride-v1")
    recording = task.load(task.split("train")[0])
    ours, theirs = (by_episode(kind(), task, recording).estimates for kind in (Woodman2008Gpu, Woodman2008))
    assert np.hypot(*(ours.xy_m - theirs.xy_m)[ours.t_s < 15.0].T).max() < 1e-3
    reference, error_m = recording.reference, []
    for answers in (ours, theirs):
        there = [np.interp(answers.t_s, reference.t_s, reference.xy_m[:, axis]) for axis in range(2)]
        error_m.append(float(np.hypot(*(answers.xy_m.T - there)).mean()))
    assert error_m[0] == pytest.approx(error_m[1], abs=4 * np.sqrt(2) * 0.03)
