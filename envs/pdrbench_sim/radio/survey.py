"""A WLAN survey: a person stands in every cell of a building and notes what a phone delivers there."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray
from pdrbench.radio import Cells, survey_of_readings
from pdrbench.recording import RadioMap
from pdrbench_sim.radio.networks import Networks
from pdrbench_sim.radio.scans import PhonePath, scan_walks
from pdrbench_sim.resolution import rounded_survey

STAYS_S: Final = 4.6  # at each place: two scans, as a rule
MAX_DURATION_S: Final = 12.0  # until one has come in any case


def survey_standing(rng: np.random.Generator, networks: Networks, cells: Cells, *, places: int = 4) -> RadioMap:
    """Stands at several places of each cell, facing another way at each; at every second one all doors are closed.

    Args:
        rng: Draws places and what is received.
        networks: Senders of the building.
        cells: Of the same building.
        places: In each cell.

    Returns:
        Scans cell by cell; `walk` is the place, whose scans depend on each other.
    """
    if places < 1:
        raise MapError(f"a survey needs one place or more in each cell; got {places}")
    where, *air = rng.spawn(1 + cells.num_cells * places)
    _, polygon, xy_m = cells.sample_each(where, places)
    facing_rad = 2 * math.pi * (np.tile(np.arange(places), cells.num_cells) + where.random(len(polygon))) / places
    still = [
        PhonePath(np.array([0.0, MAX_DURATION_S]), np.repeat(p, 2), np.tile(at, (2, 1)), np.repeat(facing, 2))
        for p, at, facing in zip(polygon, xy_m, facing_rad, strict=True)
    ]
    rows: list[FloatArray] = [np.zeros((0, 5))] * len(still)
    for first, doors_open in ((0, True), (1, False)):
        heard = scan_walks(networks, air[first::2], still[first::2], doors_open=doors_open)
        rows[first::2] = [_first_scans(walk) for walk in heard]
    place = np.repeat(np.arange(len(rows)), [len(np.unique(of_place[:, 0])) for of_place in rows])
    counts = [np.unique(of_place[:, 0], return_counts=True)[1] for of_place in rows]
    read = np.concatenate(rows)
    level = networks.field.building.level(polygon)[place]
    found = survey_of_readings(xy_m[place], level, place, np.concatenate(counts), read[:, [1, 2, 4]], surveyed=True)
    return rounded_survey(found)


def _first_scans(rows: FloatArray) -> FloatArray:
    """Those of the stay, or the first one where none came so soon."""
    if not len(rows):
        return rows
    first: FloatArray = rows[rows[:, 0] <= max(STAYS_S, rows[0, 0])]
    return first
