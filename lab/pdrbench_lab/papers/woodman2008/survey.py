"""The radio survey of Woodman & Harle 2008: scans in every cell of a building."""

from __future__ import annotations

import math

import numpy as np

from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.radio import Cells, survey_of_table
from pdrbench.recording import RadioMap
from pdrbench_lab.papers.single_scans import receive
from pdrbench_sim.radio.wlan import RadioField
from pdrbench_sim.resolution import rounded_survey


def sample_each(cells: Cells, rng: np.random.Generator, count: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Places drawn uniformly from every cell, `count` from each, cell by cell.

    Returns:
        cell: (C * count,) int.
        polygon: (C * count,) int.
        xy_m: (C * count, 2) inside it.
    """
    cell = np.repeat(np.arange(cells.num_cells), count)
    covered_m2 = np.cumsum(cells.region.triangle_area_m2())
    first = np.searchsorted(cells.cell, np.arange(cells.num_cells + 1))
    before_m2, until_m2 = np.concatenate([[0.0], covered_m2])[first[:-1]], covered_m2[first[1:] - 1]
    drawn_m2 = before_m2[cell] + rng.random(len(cell)) * (until_m2 - before_m2)[cell]
    triangle = np.searchsorted(covered_m2, drawn_m2, side="right")
    triangle = np.clip(triangle, first[cell], first[cell + 1] - 1)
    return cell, *cells.region.sample_triangles(rng, triangle)


def survey(rng: np.random.Generator, field: RadioField, cells: Cells, queries: int = 24) -> RadioMap:
    """Stands in every cell, at several places, facing all ways, with the doors open and closed (claim W13).

    Args:
        rng: Draws places and what is received.
        field: Access points and their propagation.
        cells: Of the same building.
        queries: Per cell; the paper says at least 20. Half of them with all doors closed.

    Returns:
        Scans cell by cell; `walk` is the cell.
    """
    if queries < 2:
        raise MapError(f"a survey needs doors open and closed: 2 queries or more per cell; got {queries}")
    cell, polygon, xy_m = sample_each(cells, rng, queries)
    number = np.tile(np.arange(queries), cells.num_cells)
    heading_rad = 2 * math.pi * (number + rng.random(len(cell))) / queries
    t_s = 30.0 * np.arange(len(cell))  # far enough apart to fade on their own
    rssi_dbm = receive(field, rng, t_s, polygon, xy_m, heading_rad, doors_open=number % 2 == 0)
    return rounded_survey(survey_of_table(xy_m, cells.level[cell], cell, rssi_dbm, field.access_points.id))
