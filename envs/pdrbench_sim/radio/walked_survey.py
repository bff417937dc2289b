"""A WLAN survey along walked paths, some months before, with another phone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.radio import survey_of_readings
from pdrbench.recording import RadioMap
from pdrbench_sim.people.body_line import arc_length_m, resample
from pdrbench_sim.people.route import NavigationMesh, Route
from pdrbench_sim.people.walker import draw_place
from pdrbench_sim.radio.networks import Networks
from pdrbench_sim.radio.scans import PhonePath, ScanParams, scan_walks
from pdrbench_sim.radio.wlan import Receiver, draw_opaque_ids, draw_receiver
from pdrbench_sim.resolution import rounded_survey

SURVEY_MPS: Final = 1.1  # [M] of the surveyors of ILC20
PERIOD_HEARD: Final = ScanParams().period_heard  # identifiers that set the pace of scans: of the surveyors of ILC20
CLEARANCE_M: Final = 0.3  # of a way from corners; sources.md 1.10
SPACING_M: Final = 0.5  # of the points of a survey walk; ours
REPLACED_A_MONTH: Final = 0.05  # of the boxes: they send other identifiers then (sources.md 1.9)


@dataclass(frozen=True, slots=True)
class SurveyParams:
    """How a building was surveyed.

    Attributes:
        m_per_m2: Way that was walked, for each square metre of floor; a scan comes about every two metres.
        months: Since then.
        receiver: Of the phone.
        walk_m: Length of one walk, on one level.
    """

    m_per_m2: float
    months: float
    receiver: Receiver
    walk_m: float = 120.0


def draw_survey(rng: np.random.Generator, m_per_m2: tuple[float, float], months: tuple[float, float]) -> SurveyParams:
    """Another survey: its density log-uniform, its age uniform, and a phone of its own."""
    low, high = np.log(m_per_m2)
    return SurveyParams(math.exp(rng.uniform(low, high)), float(rng.uniform(*months)), draw_receiver(rng))


def survey_walking(
    rng: np.random.Generator, networks: Networks, mesh: NavigationMesh, params: SurveyParams
) -> RadioMap:
    """Scans of survey walks between places anywhere on each level, each walk on one level.

    Args:
        rng: Draws ways, what is received, and which boxes were replaced since.
        networks: Senders of the building today.
        mesh: Of the same building.
        params: How it was surveyed.
    """
    way_rng, replaced_rng, air_rng = rng.spawn(3)
    paths = [path for level in mesh.building.levels for path in _paths(way_rng, mesh, level, params)]
    heard = scan_walks(
        networks, air_rng.spawn(len(paths)), paths, receiver=params.receiver, doors_open=True, heard=PERIOD_HEARD
    )
    scans = [np.unique(rows[:, 0], return_counts=True) for rows in heard]
    walk = np.repeat(np.arange(len(paths)), [len(t_s) for t_s, _ in scans])
    xy_m = np.concatenate([path.at(t_s, path.xy_m) for path, (t_s, _) in zip(paths, scans, strict=True)])
    level = mesh.building.level([path.polygon[0] for path in paths])[walk]
    readings = np.concatenate(heard)[:, [1, 2, 4]]
    readings[:, 0] = _before(replaced_rng, networks, params.months)[np.searchsorted(networks.id, readings[:, 0])]
    count = np.concatenate([of for _, of in scans])
    return rounded_survey(survey_of_readings(xy_m, level, walk, count, readings, surveyed=False))


def _paths(rng: np.random.Generator, mesh: NavigationMesh, level: int, params: SurveyParams) -> list[PhonePath]:
    """Survey walks on one level, one or more."""
    level_m2 = sum(polygon.area_m2 for polygon in mesh.building.polygons if polygon.level == level)
    left_m, paths = params.m_per_m2 * level_m2, list[PhonePath]()
    while left_m > 0:
        xy_m, polygon = resample(_way(rng, mesh, level, min(params.walk_m, left_m)), SPACING_M)
        heading_rad = np.unwrap(np.arctan2(*np.diff(xy_m, axis=0, append=2 * xy_m[-1:] - xy_m[-2:-1]).T[::-1]))
        t_s: FloatArray = arc_length_m(xy_m) / SURVEY_MPS
        paths.append(PhonePath(t_s, polygon, xy_m, heading_rad))
        left_m -= t_s[-1] * SURVEY_MPS
    return paths


def _way(rng: np.random.Generator, mesh: NavigationMesh, level: int, length_m: float) -> Route:
    """From place to place until it is long enough."""
    places, come_m, routes = [draw_place(rng, mesh, level=level)], 0.0, list[Route]()
    while come_m < length_m:
        places.append(draw_place(rng, mesh, level=level))
        routes.append(mesh.route(places[-2], places[-1], CLEARANCE_M))
        come_m += routes[-1].length_m
    xy_m = [routes[0].xy_m, *(route.xy_m[1:] for route in routes[1:])]
    return Route(np.concatenate(xy_m), np.concatenate([route.polygon for route in routes]))


def _before(rng: np.random.Generator, networks: Networks, months: float) -> FloatArray:
    """(B,) the identifiers of today's senders, with others where a box has been replaced since."""
    num_boxes = len(networks.field.access_points)
    is_kept = rng.random(num_boxes) < (1 - REPLACED_A_MONTH) ** months
    return np.where(is_kept[networks.box], networks.id, rng.permutation(draw_opaque_ids(rng, len(networks))))
