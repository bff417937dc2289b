from __future__ import annotations

import dataclasses
import math

import numba
import numpy as np
import pytest
import shapely

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.errors import PdrbenchError
from pdrbench.filters import FilterError
from pdrbench_baselines.li2012.map_filter import StepModel, StepModelFilter, StepModelFilterParams
from pdrbench_baselines.li2012.turns import TurnDetector
from pdrbench_formats.maps.builder import BuildingBuilder

GENERIC = StepModel(0.181, 0.334)
FEW = StepModelFilterParams(num_particles=600)
EXACT = StepModelFilterParams(
    num_particles=50, start_sigma_m=0.0, length_fraction=0.0, heading_sigma_rad=0.0, delta_a=0.0, delta_b=0.0
)
WAY = np.array([[0, 0], [31, 0], [31, 15], [0, 15], [0, 0]], dtype=float)


@pytest.fixture(scope="module")
def loop() -> Building:
    """A corridor 2 m wide around a block; its middle is 31 m by 15 m (L1)."""
    outer = [[-1, -1], [32, -1], [32, 16], [-1, 16]]
    inner = np.array([[1, 1], [1, 14], [30, 14], [30, 1]])
    return Building("loop", (FloorPolygon("way", outer, [WALL] * 8, 0.0, 0, holes=(inner,)),))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def alley() -> Building:
    outline = [[0, -1], [60, -1], [60, 1], [0, 1]]
    return Building("alley", (FloorPolygon("way", outline, [WALL] * 4, 0.0, 0),))  # type: ignore[arg-type]


def started(
    building: Building | None, params: StepModelFilterParams, seed: int = 0, at: object = (0, 0)
) -> StepModelFilter:
    particles = StepModelFilter(building, np.random.default_rng(seed), params)
    particles.start(np.array(at, dtype=float), 0, GENERIC)
    return particles


def test_without_noise_it_is_dead_reckoning() -> None:
    particles = started(None, EXACT, at=(3, 4))
    for _ in range(10):
        particles.step(2.0, math.pi / 6)
    length_m = 10 * (0.181 * 2.0 + 0.334)  # eq. (3)
    assert particles.xy_m == pytest.approx([3 + length_m * math.cos(math.pi / 6), 4 + length_m / 2])
    assert particles.sigma_m == pytest.approx(0.0, abs=1e-6)


def test_the_cloud_spreads_as_its_noise_says() -> None:
    """After one step from a point: 0.1 L along, L sin(10 degrees) across; 20 000 particles determine a sigma to 1 %."""
    params = StepModelFilterParams(num_particles=20_000, start_sigma_m=0.0, delta_a=0.0, delta_b=0.0)
    particles = started(None, params)
    particles.step(1.9, 0.0)
    length_m = GENERIC.length_m(1.9)
    along, across = particles.particles_xy_m.std(axis=0)
    assert across == pytest.approx(length_m * math.sqrt((1 - math.exp(-2 * math.radians(10) ** 2)) / 2), rel=0.03)
    assert along == pytest.approx(0.1 * length_m, rel=0.04)


def test_models_lie_around_the_generic_one_and_no_particle_walks_backwards() -> None:
    particles = started(None, StepModelFilterParams())
    assert np.ptp(particles.a) == pytest.approx(0.20, rel=0.01)  # L15
    assert np.ptp(particles.b) == pytest.approx(0.30, rel=0.01)
    assert particles.model.length_m(1.9) == pytest.approx(GENERIC.length_m(1.9), abs=0.02)
    # Walls stop all others: whoever hardly walks would be the mean of those who are left.
    particles = started(None, StepModelFilterParams(delta_a=0.5, delta_b=1.0))
    assert (particles.a * 1.9 + particles.b).min() == pytest.approx(0.05)


def test_same_generator_same_bytes_whatever_the_threads(loop: Building) -> None:
    clouds, available = [], numba.get_num_threads()
    for threads in (1, available):
        numba.set_num_threads(threads)
        particles = started(loop, FEW, seed=4)
        for _ in range(30):
            particles.step(1.9, 0.05)
        clouds.append(particles.particles_xy_m)
    assert (clouds[0] == clouds[1]).all()
    assert (clouds[0] != started(loop, FEW, seed=5).particles_xy_m).any()


def test_particles_stay_on_the_floor(loop: Building) -> None:
    particles = started(loop, FEW)
    for k in range(60):
        particles.step(1.9, 0.02 * k)
        assert loop.contains(particles.particles_xy_m, 0).mean() > 0.999  # float32 rounds on walls


def test_a_wall_takes_no_model_on_the_straight_and_takes_it_in_a_turn(alley: Building) -> None:
    particles = started(alley, FEW, at=(5, 0))
    before = particles.a.copy(), particles.b.copy()
    for _ in range(20):
        particles.step(1.9, 0.3)  # into the side
    assert (particles.a == before[0]).all()
    assert (particles.b == before[1]).all()
    particles.turned(100, 200)
    assert (particles.a == before[0]).all()
    particles.turned(0, 200)
    assert (particles.a != before[0]).mean() > 0.5
    assert set(particles.a.tolist()) <= set(before[0].tolist())


@pytest.mark.parametrize("longer_m", [-0.12, 0.12])
def test_corners_teach_the_length_of_steps(loop: Building, longer_m: float) -> None:
    """L23: half of the first error is gone after two turns. Headings err by 6 degrees, steps by 3 %."""
    left = []
    for seed in range(3):
        frequency_hz, headings_rad = _walked(np.random.default_rng(seed), GENERIC.length_m(1.9) + longer_m)
        particles, turns, number = started(loop, StepModelFilterParams(num_particles=1500), seed), TurnDetector(), 0
        for f, heading_rad in zip(frequency_hz, headings_rad, strict=True):
            particles.step(f, heading_rad)
            turn = turns.update(heading_rad)
            if turn is not None:
                particles.turned(turn.begin - 4, turn.end + 4)
                number += 1
            if number == 2:
                break
        left.append(abs(particles.model.length_m(1.9) - GENERIC.length_m(1.9) - longer_m))
        assert number == 2
        assert particles.resets == 0
    assert np.mean(left) < 0.5 * abs(longer_m)


def _walked(rng: np.random.Generator, length_m: float) -> tuple[list[float], list[float]]:
    """Frequencies and measured headings of a pedestrian who walks along `WAY` with steps of that length at 1.9 Hz."""
    along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(WAY, axis=0).T))])
    frequency_hz = 1.9 + 0.05 * rng.standard_normal(200)
    steps_m = (length_m + 0.181 * (frequency_hz - 1.9)) * (1 + 0.03 * rng.standard_normal(200))
    at_m = np.cumsum(steps_m)
    at_m = np.concatenate([[0.0], at_m[at_m < along_m[-1]]])
    xy_m = np.column_stack([np.interp(at_m, along_m, WAY[:, i]) for i in range(2)])
    true_rad = np.arctan2(*np.diff(xy_m, axis=0).T[::-1])
    measured = true_rad + np.radians(6) * rng.standard_normal(len(true_rad))
    return frequency_hz[: len(true_rad)].tolist(), measured.tolist()


def test_survivors_correct_the_heading_at_a_wall(alley: Building) -> None:
    """L13, Fig. 4: a heading that leads into the wall is turned away from it; in the open it is unchanged."""
    corrections = []
    for building in (None, alley):
        particles, taken = started(building, FEW, at=(5, 0)), []
        for _ in range(20):
            particles.step(1.9, 0.15)
            taken.append(particles.correction_rad)
        corrections.append(np.mean(taken[5:]))
    open_rad, walled_rad = corrections
    assert abs(open_rad) < 4 * math.radians(10) / math.sqrt(600 * 15)  # four standard errors
    assert walled_rad < -math.radians(1)


def test_the_middle_of_a_corridor_weighs_more(alley: Building) -> None:
    particles = started(alley, dataclasses.replace(FEW, heading_sigma_rad=0.0), at=(5, 0))
    particles.step(1.9, 0.0)
    off_m = np.abs(particles.particles_xy_m[:, 1])
    survived = particles._stopped_at < 0
    assert (particles.weight[survived & (off_m < 0.2)] == 2.0).all()
    assert (particles.weight[survived & (off_m > 0.6)] == 1.0).all()


def test_a_start_off_the_floor_is_taken_to_the_floor(loop: Building) -> None:
    particles = started(loop, FEW, at=(10, 7))  # in the block
    assert loop.contains(particles.particles_xy_m, 0).mean() > 0.999
    assert np.hypot(*(particles.xy_m - [10, 7])) > 3.0


def test_depleted_particles_are_redrawn_where_they_were(alley: Building) -> None:
    """Nobody walks through the end of an alley: the particles do not either, and the count says so."""
    params = dataclasses.replace(EXACT, start_sigma_m=0.3)
    particles = started(alley, params, at=(58, 0))
    for _ in range(8):
        particles.step(1.9, 0.0)
    assert particles.resets >= 2
    assert 50 < particles.xy_m[0] < 60
    assert alley.contains(particles.particles_xy_m, 0).mean() > 0.99


def test_the_summary_is_the_line_through_the_best_particles() -> None:
    """With the same frequencies for all, the line has their mean a and b."""
    particles = started(None, FEW)
    particles.step(1.9, 0.0)
    particles.weight[:] = 1.0
    particles.weight[:50] = 2.0
    summary = particles.summary()
    assert summary is not None
    assert summary.a_m_per_hz == pytest.approx(particles.a[:50].mean())
    assert summary.b_m == pytest.approx(particles.b[:50].mean())


def test_nothing_is_summed_up_from_particles_that_stand_still() -> None:
    """As those of a lost user before a wall, whose lengths are a centimetre and less."""
    particles = started(None, FEW)
    particles.step(1.9, 0.0)
    particles.a[:], particles.b[:] = -0.029, 0.036
    assert particles.summary() is None


def test_bad_input_is_refused() -> None:
    with pytest.raises(FilterError, match="finite"):
        started(None, FEW).step(math.nan, 0.0)
    with pytest.raises(FilterError, match="particles from 1"):
        StepModelFilterParams(num_particles=0)
    with pytest.raises(FilterError, match="near_m is 0 or more"):
        StepModelFilterParams(near_m=-1.0)
    with pytest.raises(PdrbenchError, match="positive length"):
        StepModel(0.1, -0.5)


@pytest.mark.parametrize("by_lift", [False, True])
def test_a_change_of_level_takes_every_particle_along(office: Building, by_lift: bool) -> None:
    """To the stairs of the new level where none has climbed; afterwards only stairs lead off its floor."""
    middle = office.centre()
    particles = started(office, FEW, at=middle.xy_m)
    particles.follow_levels(office, 0)
    particles.change_level(1, by_lift=by_lift)
    assert particles.level == 1
    # This office has no lift: a lift ends above where it began.
    kinds = [p for p in office.polygons if p.kind == "stairs" and p.level == 1]
    ends_m = [middle.xy_m] if by_lift else [p.outline_xy_m.mean(axis=0) for p in kinds]
    assert min(np.hypot(*(particles.xy_m - end_m)) for end_m in ends_m) < 1.0
    assert _on_stairs(office, particles, particles.particles_level != 1)
    for heading_rad in np.random.default_rng(1).uniform(-math.pi, math.pi, 40):
        particles.step(1.9, float(heading_rad))
        assert _on_stairs(office, particles, particles.particles_level != 1)
    particles.change_level(5, by_lift=False)
    assert particles.level == 1  # the highest there is


def test_who_is_in_a_lift_keeps_the_place_in_it() -> None:
    """Whether it is known to be a lift or not; at the middle of the cabin they would begin anew half a metre away."""
    builder = BuildingBuilder()
    for level in range(3):
        builder.add_level(level, height_m=3.0 * level).add_walkable(shapely.box(0, 0, 5, 5), walled=False)
    building = builder.connect("lift", levels=(0, 1, 2), polygon=shapely.box(5, 0, 7, 2)).build()
    for by_lift in (False, True):
        particles = started(building, dataclasses.replace(FEW, start_sigma_m=0.1), at=(5.5, 0.5))
        particles.follow_levels(building, 0)
        particles.change_level(2, by_lift=by_lift)
        assert particles.level == 2 and (particles.particles_level == 2).all()
        assert particles.xy_m == pytest.approx([5.5, 0.5], abs=0.05)
        assert particles.sigma_m == pytest.approx(0.1, abs=0.02)


def test_on_stairs_most_particles_stay_where_they_are(office: Building) -> None:
    """A change of level becomes known before or after the last tread; those in front draw no others along."""
    tread = next(p for p in office.polygons if p.kind == "stairs" and p.level == 0)
    middle_m = tread.outline_xy_m.mean(axis=0)
    particles = started(office, dataclasses.replace(FEW, start_sigma_m=0.05), at=middle_m)
    particles.follow_levels(office, 0)
    particles.change_level(1, by_lift=False)
    assert particles.xy_m == pytest.approx(middle_m, abs=0.05)


def _on_stairs(building: Building, particles: StepModelFilter, chosen: np.ndarray) -> bool:
    """Whether these particles stand on stairs."""
    polygons = building.locate(particles.particles_xy_m[chosen], particles.particles_level[chosen])
    return all(building.polygons[polygon].kind == "stairs" for polygon in polygons if polygon >= 0)


def test_without_a_map_only_the_level_changes() -> None:
    particles = started(None, FEW)
    particles.follow_levels(None, 0)
    particles.change_level(2, by_lift=False)
    assert particles.level == 2
    assert particles.xy_m == pytest.approx([0, 0], abs=0.5)
