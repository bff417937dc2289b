"""The block "WiFi": scans of surveyors in two recorded shopping centres beside those of surveyors in drawn ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from pdrbench.geometry import FloatArray
from pdrbench_lab.realism.block import Block, Control, Distribution, Figure, Part, Values, statistics
from pdrbench_lab.realism.malls import draw_survey_places
from pdrbench_lab.realism.phone_walks import DATASET, ROLES, surveyor_logs
from pdrbench_lab.realism.radio_statistics import FRESH_S, SurveyWalk, floor_values, walk_values
from pdrbench_sim.buildings.mall import make_mall
from pdrbench_sim.people.body_line import arc_length_m
from pdrbench_sim.people.person import draw_person
from pdrbench_sim.people.route import NavigationMesh, navigation_mesh
from pdrbench_sim.people.walk import BodyPath, body_path
from pdrbench_sim.people.walker import WalkParams, walk_through
from pdrbench_sim.radio.networks import NetworkParams, draw_mall_networks, make_networks
from pdrbench_sim.radio.scans import PhonePath, ScanParams, scan_walks

SURVEY_ROLES: Final = ("train", "radiomap")
MIN_WALKS: Final = 30  # of a recorded floor whose variogram and matching are computed
NUM_WALKS: Final = 46  # of site 1, level F1
AREA_M2: Final = (18000.0, 40000.0)  # scans of other walks lie about as far away as on that level, or nearer; ours
DURATION_S: Final = 20.0  # median as the crow walks; with the way round corners 28 s, as its walks
DURATION_LOG_SIGMA: Final = 0.62  # 5 to 95 %: 9 to 77 s
DURATION_RANGE_S: Final = (8.0, 98.0)
WAYPOINT_M: Final = (3.0, 11.0)  # between surveyed places along the way
NOVELTY: Final = 0.8  # metres of a walk that is too long or short, for a metre farther from what was walked
CHAIN_FRACTION: Final = 0.8  # of the walks begin where the one before ended
COMES_FROM_M: Final = (10.0, 40.0)  # away from where a walk begins, shortly before; ours, with the next one
STANDS_S: Final = (8.0, 30.0)  # between coming and the first mark: ages of the first scan are then as on site 1
MARK_SIGMA_M: Final = 0.5  # of a place marked on the plan by eye, per axis; ours
RATE_HZ: Final = 10.0
_STEADY: Final = WalkParams(pause_every_s=1e6)
_Change = Callable[[NetworkParams], NetworkParams]


# Recorded.


def real(part: Part) -> Values:
    """Survey walks of site 1 ("fit"), or everything else ("judge")."""
    per_walk, per_floor = [], []
    for walks in _recorded(part):
        per_walk.append(walk_values(walks))
        if len(walks) >= MIN_WALKS:
            per_floor.append(floor_values(walks))
    return _joined(per_walk, per_floor)


def _recorded(part: Part) -> list[list[SurveyWalk]]:
    """Walks by site and floor."""
    floors: dict[tuple[str, str], list[SurveyWalk]] = {}
    for file, log in surveyor_logs(part, (*ROLES, "radiomap"), SURVEY_ROLES):
        walk = SurveyWalk(log.reference.t_s, log.reference.xy_m, log.rows["wifi"])
        floors.setdefault((file.facts["site"], file.facts["floor"]), []).append(walk)
    return list(floors.values())


def _joined(per_walk: Sequence[Values], per_floor: Sequence[dict[str, float]]) -> Values:
    values = {name: np.concatenate([v[name] for v in per_walk]) for name in per_walk[0]}
    return values | {name: np.array([v[name] for v in per_floor]) for name in (per_floor[0] if per_floor else {})}


# Synthetic.


def _floors(seed: int, count: int, change: _Change | None = None, scans: ScanParams | None = None) -> Values:
    """`count` floors with their survey walks."""
    floors = [survey_floor(np.random.default_rng([seed, floor]), change, scans) for floor in range(count)]
    return _joined([walk_values(walks) for walks in floors], [floor_values(walks) for walks in floors])


def survey_floor(
    rng: np.random.Generator, change: _Change | None = None, scans: ScanParams | None = None
) -> list[SurveyWalk]:
    """A shopping centre of one level, and surveyors who walk through it as those of site 1 did.

    Args:
        rng: Two surveys from generators in the same state are equal.
        change: Applied to what `draw_mall_networks` draws.
        scans: None for the defaults.
    """
    plan_rng, radio_rng, way_rng, scan_rng, mark_rng = rng.spawn(5)
    building = make_mall(plan_rng, area_m2=float(plan_rng.uniform(*AREA_M2)))
    networks = draw_mall_networks(radio_rng)
    radio = make_networks(radio_rng, building, params=networks if change is None else change(networks))
    walks = _survey_walks(way_rng, navigation_mesh(building))
    rows = scan_walks(radio, scan_rng.spawn(len(walks)), [path for path, _ in walks], params=scans)
    rows = [wifi[wifi[:, 0] >= t_s[0]] for wifi, (_, t_s) in zip(rows, walks, strict=True)]
    marked = [path.at(t_s, path.xy_m) + MARK_SIGMA_M * mark_rng.standard_normal((len(t_s), 2)) for path, t_s in walks]
    return [SurveyWalk(t_s, xy_m, wifi) for (_, t_s), xy_m, wifi in zip(walks, marked, rows, strict=True)]


def _survey_walks(rng: np.random.Generator, mesh: NavigationMesh) -> list[tuple[PhonePath, FloatArray]]:
    """Paths of a phone, coming to where the walk begins included, and when each surveyed place was passed.

    On the recorded walks a phone lists as much and as old from the first scan on as later: it was carried there.
    Surveyors turn to places not passed before: half as many walks then leave the next scan of another walk twice as
    far away, as on the recorded floors.
    """
    person = draw_person(rng)
    pool = draw_survey_places(rng, mesh.building)
    pool_xy_m = np.array([place.xy_m for place in pool])
    new_m = np.full(len(pool), 50.0)  # from each place to the nearest path so far
    walks = []
    here = int(rng.integers(len(pool)))
    for _ in range(NUM_WALKS):
        if rng.random() >= CHAIN_FRACTION:
            here = int(new_m.argmax())
        wanted_s = np.clip(DURATION_S * math.exp(DURATION_LOG_SIGMA * rng.standard_normal()), *DURATION_RANGE_S)
        off_m = np.abs(np.hypot(*(pool_xy_m - pool_xy_m[here]).T) - person.speed_mps * wanted_s)
        off_m[here] = np.inf
        goal = int(np.argmin(off_m - NOVELTY * new_m))
        body = body_path(walk_through(rng, mesh, person, [pool[here], pool[goal]], _STEADY), RATE_HZ)
        away_m = np.hypot(*(pool_xy_m - pool_xy_m[here]).T)
        near = np.flatnonzero((away_m >= COMES_FROM_M[0]) & (away_m <= COMES_FROM_M[1]))
        origin = pool[int(rng.choice(near))] if len(near) else pool[int(away_m.argmax())]
        coming = body_path(walk_through(rng, mesh, person, [origin, pool[here]], _STEADY), RATE_HZ)
        begins_s = float(coming.t_s[-1] + rng.uniform(*STANDS_S) - body.t_s[0])
        walks.append((_one_after_the_other(coming, body, begins_s), begins_s + _waypoints_s(rng, body)))
        new_m = np.minimum(new_m, KDTree(body.xy_m).query(pool_xy_m)[0])
        here = goal
    return walks


def _one_after_the_other(one: BodyPath, other: BodyPath, shift_s: float) -> PhonePath:
    """Two paths as one, the second one so much later."""
    return PhonePath(
        np.concatenate([one.t_s, other.t_s + shift_s]),
        np.concatenate([one.polygon, other.polygon]),
        np.concatenate([one.xy_m, other.xy_m]),
        np.unwrap(np.concatenate([one.heading_rad, other.heading_rad])),
    )


def _waypoints_s(rng: np.random.Generator, body: BodyPath) -> FloatArray:
    """When the surveyor marked a place: at both ends and every few metres between."""
    s_m = arc_length_m(body.xy_m)
    at_m = np.cumsum(rng.uniform(*WAYPOINT_M, size=math.ceil(s_m[-1] / WAYPOINT_M[0]) + 1))
    t_s = np.interp(at_m[at_m < s_m[-1] - WAYPOINT_M[0]], s_m, body.t_s)
    return np.concatenate([body.t_s[:1], t_s, body.t_s[-1:]])


def _white(seed: int, count: int) -> Values:
    """Floors where RSSI is path loss with white noise, and every scan lists only what it received itself."""

    def whiten(networks: NetworkParams) -> NetworkParams:
        return replace(networks, wlan=replace(networks.wlan, shadow_sigma_db=0.0, fading_correlation_1s=0.0))

    return _floors(seed, count, whiten, ScanParams(memory_s=FRESH_S))


RADIO: Final = Block(
    name="WiFi",
    statistics=(
        *statistics(
            "walk",
            Distribution(),
            ("wifi_entries", "identifiers a scan, mean", ""),
            ("wifi_period_s", "time between scans, median", "s"),
            ("wifi_fresh", "readings younger than 2.5 s", ""),
            ("wifi_age_median_s", "age of a reading, median", "s"),
            ("wifi_age_p95_s", "age of a reading, 95 %", "s"),
        ),
        *statistics(
            "floor",
            Figure(),
            ("wifi_again_60", "readings of -60 dBm that the next sweep repeats", ""),
            ("wifi_again_75", "readings of -75 dBm that the next sweep repeats", ""),
            ("wifi_again_85", "readings of -85 dBm that the next sweep repeats", ""),
            ("wifi_variogram_0m", "RSSI of two walks at most 1 m apart, root of the variogram", "dB"),
            ("wifi_variogram_5m", "the same, 4 to 6 m apart", "dB"),
            ("wifi_variogram_12m", "the same, 11 to 13 m apart", "dB"),
            ("wifi_variogram_22m", "the same, 20 to 24 m apart", "dB"),
            ("wifi_exponent", "path-loss exponent of an identifier, median", ""),
            ("wifi_sigma_db", "residual of that fit, median", "dB"),
            ("wifi_knn_m", "error when a walk is located by the scans of the others, mean", "m"),
            ("wifi_knn_half", "by what factor it grows with half of the walks", ""),
            ("wifi_knn_quarter", "by what factor it grows with a quarter of the walks", ""),
        ),
    ),
    datasets=(DATASET,),
    real=real,
    synthetic=_floors,
    count=20,
    controls={
        "white noise": Control("RSSI is path loss with white noise, nothing is repeated", _white, "wifi_sigma_db")
    },
    features=("wifi_entries", "wifi_period_s", "wifi_fresh", "wifi_age_median_s", "wifi_age_p95_s"),
)
