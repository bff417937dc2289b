"""Paths on a floor plan, counted by hand and by a slow reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.metrics import hold_at
from pdrbench.metrics.floor_plan import crossings_per_100m, outside_pct
from pdrbench.metrics.hold import Held
from pdrbench.trajectory import Estimates, Start

NOWHERE = Start(xy_m=np.zeros(2), level=0)


def rectangle(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def closed(name: str, outline_xy_m: np.ndarray, height_m: float = 0.0, level: int = 0, **more: object) -> FloorPolygon:
    """A floor with walls all around."""
    count = len(outline_xy_m) + sum(len(hole) for hole in more.get("holes", ()))  # type: ignore[attr-defined]
    return FloorPolygon(name, outline_xy_m, np.full(count, WALL), height_m=height_m, level=level, **more)  # type: ignore[arg-type]


def two_rooms() -> Building:
    """Rooms of 10 m by 10 m on either side of the line x = 10, with a door from y = 4 to 6; and a level above."""
    west = np.array([[0.0, 0.0], [10, 0], [10, 4], [10, 6], [10, 10], [0, 10]])
    east = np.array([[10.0, 0.0], [20, 0], [20, 10], [10, 10], [10, 6], [10, 4]])
    rooms = (
        FloorPolygon("west", west, np.array([WALL, WALL, 1, WALL, WALL, WALL]), height_m=0.0, level=0),
        FloorPolygon("east", east, np.array([WALL, WALL, WALL, WALL, 0, WALL]), height_m=0.0, level=0),
        closed("above", rectangle(0, 0, 20, 10), height_m=3.5, level=1),
    )
    return Building("two rooms", rooms)


def answers(xy_m: object, level: object = 0.0) -> Held:
    xy_m = np.asarray(xy_m, dtype=float).reshape(-1, 2)
    count = len(xy_m)
    t_s = 0.2 * np.arange(count)
    estimates = Estimates(t_s, xy_m, np.broadcast_to(level, count).astype(float), *np.full((3, count), math.nan))
    return hold_at(estimates, t_s, NOWHERE, slack_s=0.0)


def num_crossed(xy_m: object, building: Building, level: object = 0.0) -> float:
    """Crossings of a path, from their rate."""
    held = answers(xy_m, level)
    length_m = np.hypot(*np.diff(held.xy_m, axis=0).T).sum()
    return crossings_per_100m(held, building) * length_m / 100


# Outside ---------------------------------------------------------------------------------------------------------


def test_outside_means_on_no_floor_polygon_of_the_level() -> None:
    places = [[5.0, 5.0], [10.0, 2.0], [0.0, 0.0], [-0.0005, 3.0], [-0.002, 3.0], [5.0, 11.0], [5.0, 5.0], [5.0, 5.0]]
    level = [0, 0, 0, 0, 0, 1, 1, 7]
    assert outside_pct(answers(places, level), two_rooms()) == pytest.approx(100 * 3 / 8)
    assert outside_pct(answers(places, level), two_rooms(), tolerance_m=0.01) == pytest.approx(100 * 2 / 8)


def test_gaps_within_the_tolerance_are_inside_and_missing_answers_hold_the_last_one() -> None:
    rooms = (closed("a", rectangle(0, 0, 5, 5)), closed("b", rectangle(5.001, 0, 9, 5)))
    assert outside_pct(answers([[5.0005, 2.0]]), Building("gap", rooms)) == 0.0
    nan = [math.nan, math.nan]
    assert outside_pct(answers([nan, [5.0, 50.0], nan, nan, [5.0, 5.0]]), two_rooms()) == 75.0


def test_without_building_or_answer_there_is_no_score() -> None:
    nothing = answers([[math.nan, 0.0]])
    for metric in (outside_pct, crossings_per_100m):
        assert math.isnan(metric(answers([[1.0, 1.0], [2.0, 2.0]]), None))
        assert math.isnan(metric(nothing, two_rooms()))
        assert math.isnan(metric(answers(np.zeros((0, 2))), two_rooms()))


# Crossings -------------------------------------------------------------------------------------------------------


def test_a_wall_is_crossed_and_a_door_is_not() -> None:
    building = two_rooms()
    assert num_crossed([[5, 2], [15, 2]], building) == pytest.approx(1)
    assert num_crossed([[15, 2], [5, 2]], building) == pytest.approx(1)
    assert num_crossed([[5, 5], [15, 5]], building) == 0
    assert num_crossed([[5, 2], [15, 2]], building, level=1.0) == 0
    assert crossings_per_100m(answers([[5, 2], [15, 2], [5, 2]]), building) == pytest.approx(10.0)


def test_paths_that_halt_on_a_wall_or_pass_a_corner_cross_once_and_jitter_never() -> None:
    building = two_rooms()
    assert num_crossed([[5, 2], [10, 2], [15, 2]], building) == pytest.approx(1)
    assert num_crossed([[5, 2], [10, 2], [10, 3], [10, 2.5], [15, 2]], building) == pytest.approx(1)
    assert num_crossed([[5, 2], [10, 2], [10, 3], [10, 2], [5, 2]], building) == 0
    assert num_crossed([[10, 2], [10, 3], [5, 3]], building) == 0, "who begins on a wall crosses none"
    assert num_crossed([[8, 8], [12, 12]], Building("room", (closed("a", rectangle(0, 0, 10, 10)),))) == pytest.approx(
        1
    )
    assert num_crossed([[8, 2], [12, 6]], two_rooms()) == pytest.approx(1), "through the door post"
    rng = np.random.default_rng(0)
    path = np.column_stack([np.linspace(1, 9, 200), 10 + rng.uniform(-0.0009, 0.0009, 200)])
    assert num_crossed(path, two_rooms()) == 0


def test_leaving_counts_and_coming_in_does_not_and_a_pillar_counts_twice() -> None:
    building = two_rooms()
    assert num_crossed([[5, 5], [5, 15]], building) == pytest.approx(1)
    assert num_crossed([[5, 15], [5, 5]], building) == 0
    assert num_crossed([[-5, 2], [25, 2]], building) == pytest.approx(2)
    rooms = (closed("a", rectangle(0, 0, 10, 10)), closed("b", rectangle(10.3, 0, 20, 10)))
    assert num_crossed([[5, 5], [15, 5]], Building("thick", rooms)) == pytest.approx(1)
    pillar = closed("a", rectangle(0, 0, 10, 10), holes=(rectangle(4, 4, 6, 6)[::-1],))
    assert num_crossed([[2, 5], [8, 5]], Building("pillar", (pillar,))) == pytest.approx(1)


def test_neither_a_step_to_another_level_nor_the_side_of_a_flight_is_a_wall() -> None:
    building = two_rooms()
    held = answers([[5, 2], [15, 2], [15, 2], [15, 7]], [0, 1, 1, 1])
    assert crossings_per_100m(held, building) == 0.0
    assert math.isnan(crossings_per_100m(answers([[5, 2], [15, 2]], [0, 1]), building))
    assert math.isnan(crossings_per_100m(answers([[5, 2], [5, 2]]), building))
    stairs = closed("flight", rectangle(4, -5, 6, 8), height_m=1.5, kind="stairs")
    building = Building("under the stairs", (closed("hall", rectangle(0, 0, 10, 10)), stairs))
    assert num_crossed([[1, 5], [9, 5]], building) == 0
    assert num_crossed([[5, -2], [9, -2]], building) == pytest.approx(1), "beside the hall it is one"


def test_counts_agree_with_a_slow_reference() -> None:
    rng, yaw_rad = np.random.default_rng(3), 0.7
    turn = np.array([[math.cos(yaw_rad), math.sin(yaw_rad)], [-math.sin(yaw_rad), math.cos(yaw_rad)]])
    rooms = [
        closed(f"{i}-{j}-{k}", rectangle(5 * i, 4 * j, 5 * i + 5 - k % 2, 4 * j + 4) @ turn, 3.0 * k, k)
        for i in range(6) for j in range(5) for k in range(2)
    ]  # fmt: skip
    building = Building("grid", tuple(rooms))
    path = np.cumsum(rng.normal(0, 3, (150, 2)), axis=0) % [32, 22] @ turn
    level = (np.arange(150) // 25) % 2
    counted = length_m = 0.0
    for start, end, here, then in zip(path[:-1], path[1:], level[:-1], level[1:], strict=True):
        if here != then:
            continue
        length_m += math.dist(start, end)
        for p, q, polygon in zip(building.edge_start_xy_m, building.edge_end_xy_m, building.edge_polygon, strict=True):
            (dx_m, dy_m), (ex_m, ey_m) = end - start, q - p
            if building.polygons[polygon].level == here and dx_m * ey_m - dy_m * ex_m > 0:
                counted += shapely.LineString([start, end]).crosses(shapely.LineString([p, q]))
    assert counted > 100
    assert crossings_per_100m(answers(path, level), building) == pytest.approx(100 * counted / length_m)
