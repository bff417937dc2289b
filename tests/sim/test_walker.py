from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building.connectivity import reachable_parts
from pdrbench_sim.buildings.office import OfficeParams, make_office
from pdrbench_sim.buildings.walls import walls_along
from pdrbench_sim.people.body_line import resample
from pdrbench_sim.people.elastic_band import relax_band
from pdrbench_sim.people.route import Place, RouteError, navigation_mesh
from pdrbench_sim.people.strides import stances
from pdrbench_sim.people.walk import WalkError, body_path, standing_turn_rad
from pdrbench_sim.people.walker import WalkParams, draw_place, walk_through


@pytest.fixture(scope="module")
def paths(walks):
    return [body_path(walk) for walk in walks]


def test_the_body_never_crosses_a_wall_and_keeps_off_it(office, paths):
    for path in paths:
        reached, alive = office.move(path.polygon[:-1], path.xy_m[:-1], path.xy_m[1:])
        assert alive.all()
        np.testing.assert_array_equal(reached, path.polygon[1:])
    for path in paths:
        few = slice(None, None, 5)
        near_m = walls_along(office, path.xy_m[few], path.polygon[few], 1.0, 3).distance_m(path.xy_m[few], 1.0)
        # Places are 0.5 m from walls and routes 0.3 m; 2 mm is for the arc between two points 0.1 m apart.
        assert near_m.min() >= WalkParams().min_clearance_m - 2e-3
        assert 0.5 < np.median(near_m) < 0.95  # corridors are 1.8 to 2.4 m wide, doors 0.9 m


def test_a_person_moves_smoothly(paths, person):
    for path in paths:
        step_mps = np.hypot(*np.diff(path.xy_m, axis=0).T) * 50
        # Speed varies by 8 %; four sigma.
        assert step_mps.max() < person.speed_mps * math.exp(4 * 0.08)
        accel_mps2 = np.diff(path.speed_mps) * 50
        assert np.abs(accel_mps2).max() < WalkParams().accel_mps2 + 0.05
        # v^2 kappa <= 1.2 m/s^2 up to the smoothing of kappa; standing turns make 90 degrees in 1.1 s, 123 deg/s peak.
        turn_radps = np.abs(np.diff(path.heading_rad)) * 50
        assert np.quantile(turn_radps, 0.999) < math.radians(130)


def test_height_follows_the_floor_and_way_and_time_are_inverse(office, paths, walks):
    for path in paths:
        assert np.abs(path.z_m - office.height(path.polygon)).max() < 0.18
        assert np.abs(np.diff(path.z_m)).max() < 0.02 * 1.5 * 0.75  # 1.5 m/s on a slope of 0.18 / 0.28
    bout = walks[0].bouts[0]
    t_s = np.linspace(bout.t_s[0] + 0.01, bout.t_s[-1] - 0.01, 500)
    np.testing.assert_allclose(bout.time_s(bout.way_m(t_s)), t_s, atol=1e-6)


def test_bouts_join_without_a_jump(walks):
    for walk in walks:
        for before, after in zip(walk.bouts, walk.bouts[1:], strict=False):
            np.testing.assert_allclose(before.xy_m[-1], after.xy_m[0], atol=1e-9)
            assert before.polygon[-1] == after.polygon[0]
            assert before.speed_mps[-1] == after.speed_mps[0] == 0


def test_no_pedestrian_sets_out_after_the_last_train(mesh, person):
    rng = np.random.default_rng(3)
    places = [draw_place(rng, mesh) for _ in range(6)]
    short = walk_through(np.random.default_rng(0), mesh, person, places, until_s=30.0)
    whole = walk_through(np.random.default_rng(0), mesh, person, places)
    assert 30 <= short.end_s < whole.end_s
    for one, other in zip(short.bouts, whole.bouts, strict=False):
        assert one.xy_m.tobytes() == other.xy_m.tobytes()


@pytest.mark.parametrize("name", ["l_room", "ring", "two_rooms"])
def test_any_building_can_be_walked(request, person, name):
    building = request.getfixturevalue(name)
    mesh = navigation_mesh(building)
    rng = np.random.default_rng(4)
    places = [Place(0, [2, 2])]
    part = reachable_parts(building, by_lift=False)
    while len(places) < 8:
        place = draw_place(rng, mesh)
        if part[place.polygon] == part[0]:
            places.append(place)
    path = body_path(walk_through(rng, mesh, person, places))
    _, alive = building.move(path.polygon[:-1], path.xy_m[:-1], path.xy_m[1:])
    assert alive.all()


# The band that makes a way smooth.


def relaxed(xy_m, walls, rounds, clearance_m, comfort_m, soft, hard):
    """Readable reference of the kernel."""
    xy_m = xy_m.copy()
    for _ in range(rounds):
        xy_m[1:-1] = (xy_m[:-2] + 2 * xy_m[1:-1] + xy_m[2:]) / 4
        tangent = np.gradient(xy_m, axis=0)
        tangent /= np.maximum(np.hypot(*tangent.T), 1e-9)[:, None]
        left = np.column_stack([-tangent[:, 1], tangent[:, 0]])
        offset_m = np.column_stack(walls.offsets_m(xy_m))
        distance_m = np.maximum(np.hypot(*offset_m.T), 1e-9)
        sideways = (offset_m * left[walls.point]).sum(axis=1) / distance_m
        strength = hard * np.maximum(clearance_m - distance_m, 0) + soft * np.maximum(comfort_m - distance_m, 0)
        push = np.zeros((2, len(xy_m)))
        np.maximum.at(push, ((sideways > 0).astype(int), walls.point), strength * np.abs(sideways))
        xy_m[1:-1] += ((push[0] - push[1])[:, None] * left)[1:-1]
    return xy_m


def test_the_band_agrees_with_a_readable_reference(office, mesh):
    rng = np.random.default_rng(6)
    xy_m, polygon = resample(mesh.route(draw_place(rng, mesh, level=0), draw_place(rng, mesh, level=1)), 0.1)
    walls = walls_along(office, xy_m, polygon, 1.6, 20)
    settings = (40, 0.4, 0.9, 0.1, 0.5)
    band = xy_m.copy()
    relax_band(band, walls.point, walls.start_xy_m.T, walls.end_xy_m.T, *settings)
    np.testing.assert_allclose(band, relaxed(xy_m, walls, *settings), atol=1e-9)
    np.testing.assert_array_equal(band[[0, -1]], xy_m[[0, -1]])
    assert np.abs(band - xy_m).max() > 0.1


# What is off by default.


def there_and_back(corridor, person, params, seed=0, times=3):
    places = [Place(0, [2, 2]), Place(0, [118, 2])] * times
    return walk_through(np.random.default_rng(seed), navigation_mesh(corridor), person, places, params)


def test_runs_are_as_fast_as_runs_and_leave_the_walking_as_it_was(corridor, person):
    walked, some = (
        there_and_back(corridor, person, replace(WalkParams(), run_fraction=fraction), times=10)
        for fraction in (0.0, 0.5)
    )
    is_run = np.array([bout.is_run for bout in some.bouts])
    assert not any(bout.is_run for bout in walked.bouts)
    assert 0.2 < is_run.mean() < 0.8  # 0.5 of some 20: four sigma are 0.45, and the seed is fixed
    for one, other in zip(walked.bouts, some.bouts, strict=True):
        assert one.xy_m.tobytes() == other.xy_m.tobytes()
        assert other.is_run or one.speed_mps.tobytes() == other.speed_mps.tobytes()
    fastest_mps = [np.median(bout.speed_mps) for bout in some.bouts if bout.is_run and bout.s_m[-1] > 50]
    # 2.5 to 2.75 steps a second of 0.85 to 1.05 m are 2.1 to 2.9 m/s; moods have 8 %.
    assert min(fastest_mps) > 1.9
    assert max(fastest_mps) < 3.2


def test_no_pedestrian_runs_on_stairs_or_for_a_few_steps(mesh, person):
    rng = np.random.default_rng(5)
    places = [draw_place(rng, mesh, level=level) for level in (0, 1, 1, 0, 0)]
    walk = walk_through(rng, mesh, person, places, WalkParams(run_fraction=1.0))
    kinds = [{mesh.building.polygons[p].kind for p in bout.polygon} for bout in walk.bouts]
    assert any(bout.is_run for bout in walk.bouts)
    for bout, kind in zip(walk.bouts, kinds, strict=True):
        assert bout.is_run == (kind == {"floor"} and bout.s_m[-1] >= 10)


def test_a_pedestrian_who_turns_round_still_arrives(corridor, person):
    params = WalkParams(u_turn_fraction=1.0, pause_every_s=1e9)
    walk = there_and_back(corridor, person, params, times=1)
    assert len(walk.bouts) == 3
    along = [np.sign(bout.xy_m[-1, 0] - bout.xy_m[0, 0]) for bout in walk.bouts]
    assert along == [1, -1, 1]
    np.testing.assert_allclose(walk.bouts[-1].xy_m[-1], [118, 2], atol=1e-6)
    turned_rad = [abs(standing_turn_rad(a, b)) for a, b in zip(walk.bouts, walk.bouts[1:], strict=False)]
    assert min(turned_rad) > math.radians(150)


@pytest.mark.parametrize("rate_hz", [0.2, 10.0])
def test_the_body_is_the_same_at_any_rate(walks, paths, rate_hz):
    # 85 bouts in a walk have gaps and bouts shorter than 5 s, which a slow rate jumps over.
    slow = body_path(walks[0], rate_hz)
    assert slow.t_s[-1] <= walks[0].end_s < slow.t_s[-1] + 1 / rate_hz
    fine = body_path(walks[0], 200.0)
    row = np.rint(slow.t_s * 200.0).astype(int)
    np.testing.assert_allclose(slow.xy_m, fine.xy_m[row], atol=1e-9)
    np.testing.assert_array_equal(slow.polygon, fine.polygon[row])
    np.testing.assert_allclose(slow.z_m, fine.z_m[row], atol=1e-9)
    np.testing.assert_allclose(slow.heading_rad, fine.heading_rad[row], atol=1e-9)


# Bad input.


@pytest.mark.parametrize("rate_hz", [0.0, -50.0, math.nan, math.inf])
def test_a_body_is_not_sampled_at_no_rate(walks, rate_hz):
    with pytest.raises(WalkError, match="positive rate"):
        body_path(walks[0], rate_hz)


@pytest.mark.parametrize("until_s", [0.0, -5.0, math.nan])
def test_a_walk_without_duration_is_an_error(mesh, person, until_s):
    rng = np.random.default_rng(0)
    places = [draw_place(rng, mesh) for _ in range(2)]
    with pytest.raises(WalkError, match="some seconds"):
        walk_through(rng, mesh, person, places, until_s=until_s)


@pytest.mark.parametrize("places", [[], [Place(0, [1, 1])], [Place(0, [1, 1]), Place(0, [1, 1])]])
def test_places_to_go_to_are_needed(l_room, person, places):
    with pytest.raises(RouteError, match=r"two places or more|no length; leave one"):
        walk_through(np.random.default_rng(0), navigation_mesh(l_room), person, places)


@pytest.mark.parametrize(
    "wrong", [{"run_fraction": 1.5}, {"u_turn_fraction": math.nan}, {"accel_mps2": 0.0}, {"pause_every_s": -1.0}]
)
def test_ways_of_walking_that_make_no_sense_are_named(wrong):
    with pytest.raises(WalkError, match=next(iter(wrong))):
        WalkParams(**wrong)


def test_a_lift_carries_a_person_from_level_to_level(person, rng):
    building = make_office(rng, num_levels=2, area_m2=1500.0, params=OfficeParams(has_lifts=True))
    mesh = navigation_mesh(building)
    cabins = sorted(((p.id.partition("/")[2], p.level, i) for i, p in enumerate(building.polygons) if p.kind == "lift"))
    (_, _, low), (_, _, high) = cabins[:2]
    middle_m = building.polygons[low].outline_xy_m.mean(axis=0)
    rooms = [draw_place(rng, mesh, level=level) for level in (0, 1)]
    walk = walk_through(rng, mesh, person, [rooms[0], Place(low, middle_m), Place(high, middle_m), rooms[1]])
    path = body_path(walk)
    rises = np.flatnonzero(np.diff(path.z_m) > 1e-9)
    in_cabin = np.isin(path.polygon[rises], [low, high])
    assert in_cabin.all()  # and on no stairs
    assert path.z_m[-1] == building.height(high)
    assert building.level(path.polygon[[0, -1]]).tolist() == [0, 1]
    assert 1.0 < np.diff(path.z_m).max() * 50 < 2.0  # at most one and a half times the mean speed
    assert path.speed_mps[rises].max() == 0.0
    for foot in stances(walk, rng):
        assert building.level(foot.polygon[[0, -1]]).tolist() == [0, 1]
        assert (np.diff(foot.mid_s) > 0).all()
