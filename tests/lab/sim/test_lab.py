from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
import shapely

from pdrbench.building import WALL, Building
from pdrbench.building.connectivity import reachable_parts
from pdrbench.errors import MapError
from pdrbench.filters.kld import kld_bound
from pdrbench_lab.papers.woodman2008.lab_stride.lab import ROOMS, in_tracked_wing, make_lab, tracked_outline
from pdrbench_lab.papers.woodman2008.lab_stride.plan import LabParams


@pytest.fixture(scope="module")
def labs() -> list[Building]:
    return [make_lab(np.random.default_rng(seed)) for seed in range(3)]


@pytest.fixture(scope="module")
def lab(labs) -> Building:
    return labs[0]


def neighbours(building: Building, index: int) -> set[int]:
    return set(building.polygons[index].neighbour.tolist()) - {WALL}


def uses(building: Building) -> dict[str, str]:
    return {zone.id: zone.kind for zone in building.zones}


def prior_is_near_the_papers(building: Building) -> bool:
    """Whether drawing the uniform prior stops between 4.1 and 5.0 million particles (W11).

    n particles are expected in 36 sum(1 - exp(-n p / 36)) bins of 10 degrees over cubes of 1 m that each hold a
    fraction p of the floor, estimated from 70 places a cube; that sees slivers less often than the prior would, which
    lowers the number of bins by less than 1 %.
    """
    polygon, xy_m = building.sample_uniform(np.random.default_rng(0), 800_000)
    cube = np.floor(np.column_stack([xy_m, building.height(polygon)])).astype(np.int64) + 512
    _, count = np.unique((cube[:, 0] * 1024 + cube[:, 1]) * 1024 + cube[:, 2], return_counts=True)
    fraction = count / count.sum()
    few, many = (kld_bound(int(36 * -np.expm1(-n * fraction / 36).sum()), 0.05, 2.3263) for n in (4.1e6, 5.0e6))
    return few > 4.1e6 and many < 5.0e6


def test_area_and_levels_are_those_of_the_paper(labs):
    for building in labs:
        assert building.area_m2 == pytest.approx(8725, rel=0.01)
        assert building.levels == (0, 1, 2)


def test_the_uniform_prior_needs_as_many_particles_as_in_the_paper(lab):
    assert prior_is_near_the_papers(lab)


def test_every_floor_polygon_is_reachable_from_every_other(labs):
    for building in labs:
        assert not reachable_parts(building, by_lift=False).any()


def test_same_generator_state_gives_the_same_bytes_and_another_seed_another_building(labs):
    assert make_lab(np.random.default_rng(0)).sha256 == labs[0].sha256
    widths = {tuple(np.round(building.bounds_m(2), 1)) for building in labs}
    assert len(widths) == len(labs)


def test_polygons_of_one_level_do_not_overlap(lab):
    for level in lab.levels:
        total_m2 = sum(p.area_m2 for p in lab.polygons if p.level == level)
        assert lab.walkable(level).area == pytest.approx(total_m2, abs=1e-6)


def test_walls_are_thick_and_doors_lead_through_them(lab):
    rooms = [p for p in lab.polygons if uses(lab).get(p.id) in ROOMS and p.level == 1]
    outlines = [shapely.Polygon(p.outline_xy_m) for p in rooms]
    one, other = shapely.STRtree(outlines).query(outlines, predicate="dwithin", distance=0.15)
    assert (one == other).all()
    doors = [i for i, polygon in enumerate(lab.polygons) if re.search(r"-door(-\d)?$", polygon.id)]
    assert len(doors) > 200
    for door in doors:
        assert len(neighbours(lab, door)) == 2
        assert np.sum(lab.polygons[door].neighbour == WALL) == 2
        width_m = np.hypot(*np.diff(lab.polygons[door].outline_xy_m[:2], axis=0)[0])
        depth_m = lab.polygons[door].area_m2 / width_m
        assert any(
            wide == pytest.approx(0.9, abs=2e-3) or wide == pytest.approx(1.6, abs=2e-3) for wide in (width_m, depth_m)
        )


def test_three_stairwells_or_more_with_even_risers_join_the_levels(labs):
    for building in labs:
        halves = [p.id for p in building.polygons if p.id.endswith("-half")]
        assert len({name[1:] for name in halves}) >= 3
        assert len(halves) == 2 * len({name[1:] for name in halves})
        edges = np.flatnonzero(building.edge_neighbour != WALL)
        one, other = building.edge_polygon[edges], building.edge_neighbour[edges]
        is_tread = np.array([re.search(r"-(up|down)-\d+$", p.id) is not None for p in building.polygons])
        rise_m = np.abs(building.height(one) - building.height(other))[is_tread[one] | is_tread[other]]
        np.testing.assert_allclose(rise_m, rise_m[0], atol=1.1e-3)  # heights are whole millimetres
        assert 0.15 <= rise_m[0] <= 0.18


def test_rows_of_the_theatre_rise_and_only_the_aisle_joins_them(labs):
    for building in labs:
        ids = [polygon.id for polygon in building.polygons]
        rows = [i for i, name in enumerate(ids) if "theatre-row-" in name]
        numbers = np.array([int(ids[i].split("-")[2]) for i in rows])
        assert numbers.max() >= 5
        for row, number in zip(rows, numbers, strict=True):
            assert {ids[i] for i in neighbours(building, row)} == {
                f"0/theatre-aisle-{number}-{part}" for part in ("low", "high")
            }
        # Each row is higher by two risers, and the highest stays nearer to level 0 than to level 1.
        heights_m = np.unique(building.height(rows).round(9))
        np.testing.assert_allclose(np.diff(heights_m), heights_m[0])
        assert 0.25 < heights_m[0] < 0.35
        assert heights_m[-1] < building.height(ids.index("1/street")) / 2
        # The aisle is one flight of treads from the stage to the last row.
        aisle = [
            "0/theatre",
            *(f"0/theatre-aisle-{n + 1}-{part}" for n in range(numbers.max()) for part in ("low", "high")),
        ]
        for lower, upper in itertools.pairwise(aisle):
            assert ids.index(upper) in neighbours(building, ids.index(lower))
            rise_m = building.height(ids.index(upper)) - building.height(ids.index(lower))
            assert rise_m == pytest.approx(heights_m[0] / 2)


def test_levels_and_wings_repeat_but_not_altogether(labs):
    for building in labs:
        outlines = [
            {
                p.outline_xy_m.tobytes()
                for p in building.polygons
                if p.level == level and uses(building).get(p.id) in ROOMS
            }
            for level in building.levels
        ]
        for lower, upper in itertools.pairwise(outlines):
            assert 0.3 < len(lower & upper) / len(upper) < 0.98
        # Seen from the street, a row of one wing has the walls of a row of another wing.
        rows: dict[str, list[float]] = {}
        for polygon in building.polygons:
            found = re.fullmatch(r"2/(wing-[ns]\d[ab])-\d\d", polygon.id)
            if found:
                rows.setdefault(found[1], []).extend(np.abs(polygon.outline_xy_m[:, 1]).round(2).tolist())
        walls = [tuple(sorted(set(y_m))) for y_m in rows.values()]
        assert 2 <= len(set(walls)) < len(walls)


def test_the_tracked_zone_is_a_wing_of_level_2_with_corridor_and_rooms(labs):
    for building in labs:
        (zone,) = [zone for zone in building.zones if zone.kind == "tracked"]
        assert zone.level == 2
        size_m = np.ptp(tracked_outline(building), axis=0)
        assert 15 <= size_m[1] <= 20
        assert 8 <= size_m[0] <= 13
        middles = np.array([z.outline_xy_m.mean(axis=0) for z in building.zones])
        inside = in_tracked_wing(building, middles, np.array([z.level for z in building.zones]))
        kinds = [z.kind for z, is_inside in zip(building.zones, inside, strict=True) if is_inside]
        assert sum(kind in ROOMS for kind in kinds) >= 4
        centre = tracked_outline(building).mean(axis=0)[None]
        assert building.polygons[building.locate(centre, 2)[0]].id.endswith("-corridor")
        np.testing.assert_array_equal(in_tracked_wing(building, np.repeat(centre, 3, axis=0), np.arange(3)), [0, 0, 1])


def test_a_building_without_such_a_zone_is_refused(office):
    with pytest.raises(MapError, match="no zone of kind 'tracked'; take one from make_lab"):
        tracked_outline(office)


def test_sizes_that_allow_no_such_building_are_refused():
    with pytest.raises(MapError, match="no building of 8725 m2 found"):
        make_lab(np.random.default_rng(0), params=LabParams(court_m=(200.0, 220.0)))
