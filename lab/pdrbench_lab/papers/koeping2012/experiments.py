"""Experiments behind the claims of Köping et al. 2012; `claims` holds the table.

Floors and walks are those of the test split of `BuildingSite-v1` and `BuildingSiteDrift-v1`, one for each seed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from pdrbench.building import Building
from pdrbench.building.polygons import FloorPolygon
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.localizer import Briefing, Localizer, Observation
from pdrbench.sensors.position import PositionErrors
from pdrbench_baselines.koeping2012.localizer import Koeping2012, KoepingParams
from pdrbench_baselines.koeping2012.movement import MovementParams, build_table, movement_table
from pdrbench_baselines.koeping2012.movement_cells import cut_floor
from pdrbench_baselines.koeping2012.movement_kernels import draw_sorted
from pdrbench_lab.papers.koeping2012.heading import Koeping2012Heading
from pdrbench_lab.papers.koeping2012.linear import linear_walk
from pdrbench_lab.papers.koeping2012.positions import Reading, measure
from pdrbench_lab.papers.paper_walks import map_of, walk_of

ENVS: Final[Mapping[Reading, str]] = {"iid": "BuildingSite-v1", "drift": "BuildingSiteDrift-v1"}
COUNTS: Final = (50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000)  # particles of Fig. 2
SPEED_COUNTS: Final = (1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000)  # of Fig. 3
ENOUGH: Final = 2000  # K8
RUNS: Final = 3  # of a filter with few particles, whose error varies from run to run
DRAWS: Final = 10  # of the errors of the sensor, on the walk of a seed
AT_S: Final = 120.0  # K11
UPDATES_TIMED: Final = 20


def play(
    localizer: Localizer, briefing: Briefing, rows: FloatArray, rng: np.random.Generator, until_s: float = np.inf
) -> FloatArray:
    """(T, 2) answers of a localizer to rows (T, 3) of `position`, handed over one by one."""
    localizer.reset(briefing, rng)
    answers = [
        localizer.step(Observation(float(row[0]), {"position": row[None]})).xy_m for row in rows if row[0] <= until_s
    ]
    return np.array(answers)


def accuracy(seed: int) -> dict[str, Any]:
    """Mean error over the walk against the number of particles (K8, Fig. 2), of both readings of the sensor."""
    found: dict[str, Any] = {}
    for reading in ENVS:
        recording, briefing = walk_of(ENVS[reading], seed)
        rows, true_m = recording.streams["position"].rows, recording.reference.xy_m

        def error_m(runs: int, **options: Any) -> float:
            made = Koeping2012(KoepingParams(revises=False, **options))
            answers = (play(made, briefing, rows, np.random.default_rng([seed, run])) for run in range(runs))  # noqa: B023
            return float(np.mean([np.hypot(*(xy_m - true_m).T).mean() for xy_m in answers]))  # noqa: B023

        by_count = [error_m(RUNS if count <= ENOUGH else 1, num_particles=count) for count in COUNTS]
        found[f"{reading}_error_m"] = by_count
        found[f"{reading}_ratio"] = by_count[COUNTS.index(ENOUGH)] / by_count[-1]
        found[f"{reading}_map_m"] = error_m(RUNS, estimate="map")
        found[f"{reading}_sensor_m"] = float(np.hypot(*(rows[:, 1:] - true_m).T).mean())
    return found


def beyond(seed: int) -> dict[str, Any]:
    """Error after two minutes with and without heading and speed in the particle (K11).

    The errors of the sensor are drawn ten times for the walk of a seed; its error at one time would be mostly chance.
    """
    makes: dict[str, Callable[[], Localizer]] = {"literal": Koeping2012, "heading": Koeping2012Heading}
    found: dict[str, Any] = {}
    for reading in ENVS:
        recording, briefing = walk_of(ENVS[reading], seed)
        reference = recording.reference
        last = int(np.searchsorted(reference.t_s, AT_S))
        errors_m: dict[str, list[FloatArray]] = {name: [] for name in (*makes, "sensor")}
        deaths = 0
        for draw in range(DRAWS):
            rows = measure(reference.t_s, reference.xy_m, np.random.default_rng([seed, 11, draw]), reading)[: last + 1]
            answers = {"sensor": rows[:, 1:]}
            for name, make in makes.items():
                localizer = make()
                answers[name] = play(localizer, briefing, rows, np.random.default_rng([seed, draw]))
            deaths += int(localizer.debug()["deaths"])  # type: ignore[attr-defined]
            for name, xy_m in answers.items():
                errors_m[name].append(np.hypot(*(xy_m - reference.xy_m[: last + 1]).T))
        for name, by_draw in errors_m.items():
            found[f"{reading}_{name}_m"] = float(np.mean([error_m[last] for error_m in by_draw]))
            found[f"{reading}_{name}_curve_m"] = np.mean(by_draw, axis=0)
        found[f"{reading}_ratio"] = found[f"{reading}_heading_m"] / found[f"{reading}_literal_m"]
        found[f"{reading}_deaths"] = deaths / DRAWS
    return found


def table(seed: int) -> dict[str, Any]:
    """The movement table of a floor, and what the algorithm does with it (K2, K4, K6)."""
    recording, _ = walk_of(ENVS["iid"], seed)
    building = map_of(recording)
    made = build_table(building)
    rng = np.random.default_rng([seed, 4])
    cell = int(rng.integers(made.num_cells))
    draws = 200_000
    to, probability = made.row(cell)
    reached = np.bincount(made.move(np.full(draws, cell), rng), minlength=made.num_cells)
    weight = rng.random(made.num_cells) ** 2
    drawn = np.bincount(draw_sorted(weight, rng.standard_exponential(draws + 1)), minlength=made.num_cells)
    started = np.bincount(made.start(rng, draws), minlength=made.num_cells)
    return {
        "area_m2": building.area_m2,
        "cells_m2": made.cells.area_m2.sum(),
        "num_cells": made.num_cells,
        "num_entries": len(made.to),
        "megabytes": made.nbytes / 1e6,
        "least_probability": min(made.row(one)[1].min() for one in range(0, made.num_cells, 50)),
        "start_spread": _spread(started, draws * made.cells.area_m2 / made.cells.area_m2.sum()),
        "move_spread": _spread(reached[to], draws * probability),
        "moved_elsewhere": int(draws - reached[to].sum()),
        "draw_spread": _spread(drawn, draws * weight / weight.sum()),
        "longest_detour": _longest_detour(),
        **_sensor(seed),
    }


def _spread(counts: FloatArray | IntArray, expected: FloatArray) -> float:
    """Chi-square per degree of freedom: 1 where only chance makes the difference."""
    usual = expected > 20
    return float((((counts - expected) ** 2 / expected)[usual]).sum() / (usual.sum() - 1))


def _longest_detour() -> float:
    """The longest way in the table over the straight line, in an empty hall, beyond a cell's size."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    hall = FloorPolygon("hall", np.array([[0, 0], [20, 0], [20, 20], [0, 20]], dtype=float), np.full(4, -1), 0.0, 0)
    cells = cut_floor(Building("hall", (hall,)), MovementParams().cell_m)
    graph: Any = csr_array((cells.way_m, cells.pair.T), shape=(len(cells), len(cells)))
    middle = int(np.argmin(np.hypot(*(cells.xy_m - 10.0).T)))
    way_m = dijkstra(graph, directed=False, indices=[middle])[0]
    straight_m = np.hypot(*(cells.xy_m - cells.xy_m[middle]).T)
    far = straight_m > 1.0
    return float((way_m[far] / straight_m[far]).max())


def _sensor(seed: int) -> dict[str, float]:
    """Mean variance per axis of the sensor after two minutes, over what its model says (K5), and correlation."""
    t_s = np.arange(0.0, AT_S + 1)
    still = np.zeros((len(t_s), 2))
    found = {}
    for reading in ENVS:
        rows = np.array([measure(t_s, still, np.random.default_rng([seed, 5, k]), reading)[:, 1:] for k in range(400)])
        model = float(PositionErrors().sigma_m(np.array(AT_S))) ** 2
        found[f"{reading}_variance"] = float((rows[:, -1] ** 2).mean() / model)
        found[f"{reading}_correlation"] = float(np.corrcoef(rows[:, -1].ravel(), rows[:, -11].ravel())[0, 1])
    return found


def linear(seed: int) -> dict[str, Any]:
    """Errors at the end of the straight walk of 14 m (K10)."""
    walked = linear_walk(np.random.default_rng([seed, 10]))
    names = ("raw_m", "corrected_m", "updated_m", "in_hand_m", "on_foot_m")
    return {name: walked.end_error_m(name) for name in names}


def speed(seed: int) -> dict[str, Any]:
    """Time of an update against the number of particles (K9, Fig. 3), and of making tables (K4)."""
    from pdrbench_lab.papers.woodman2008.lab_stride.lab import make_lab

    recording, briefing = walk_of(ENVS["iid"], seed)
    building = map_of(recording)
    build_table(building)  # compiles
    began_s = time.perf_counter()
    build_table(building)
    replica_s = time.perf_counter() - began_s
    office = make_lab(np.random.default_rng([seed, 8725]))
    began_s = time.perf_counter()
    lab = build_table(office)
    lab_s = time.perf_counter() - began_s
    movement_table.cache_clear()
    rows = recording.streams["position"].rows[: UPDATES_TIMED + 1]
    update_s = []
    for count in SPEED_COUNTS:
        localizer = Koeping2012(KoepingParams(num_particles=count, revises=False))
        localizer.reset(briefing, np.random.default_rng(0))
        took_s = []
        for row in rows if count <= 100_000 else rows[:6]:
            began_s = time.perf_counter()
            localizer.step(Observation(float(row[0]), {"position": row[None]}))
            took_s.append(time.perf_counter() - began_s)
        update_s.append(float(np.median(took_s[1:])))
    from_10000 = SPEED_COUNTS.index(10_000)
    powers = [np.polyfit(np.log(SPEED_COUNTS[k:]), np.log(update_s[k:]), 1)[0] for k in (0, from_10000)]
    return {
        "update_s": update_s,
        "at_100000_s": update_s[SPEED_COUNTS.index(100_000)],
        "exponent": float(powers[0]),
        "exponent_of_many": float(powers[1]),
        "replica_s": replica_s,
        "lab_s": lab_s,
        "lab_cells": lab.num_cells,
        "lab_entries": len(lab.to),
        "lab_megabytes": lab.nbytes / 1e6,
    }
