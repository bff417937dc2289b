"""Experiments behind the claims of Woodman & Harle 2008; `claims` holds the table.

Buildings and walks are those of the test split of `LabStrideLost-v2` and `LabStrideWifi-v2`, one for each seed.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pandas as pd

from pdrbench.building import Building, FloorRegion
from pdrbench.filters.kld import kld_bound, normal_quantile
from pdrbench.filters.map_walk import MAX_EXPONENT
from pdrbench.geometry import BoolArray, FloatArray, IntArray, wrap_rad
from pdrbench.localizer import Briefing, Observation
from pdrbench.radio.cells import divide
from pdrbench.recording import Recording
from pdrbench_baselines.woodman2008.localizer import WOODMAN2008, Woodman2008
from pdrbench_baselines.woodman2008.map_filter import WoodmanFilter
from pdrbench_baselines.woodman2008.params import HeadingPrior, ParticleCloud, WoodmanFilterParams
from pdrbench_baselines.woodman2008.visibility import VisibilityMap
from pdrbench_lab.papers.paper_walks import map_of, walk_of
from pdrbench_lab.papers.settings import merged
from pdrbench_lab.papers.woodman2008.literal import FILTERS, LiteralFilter

if TYPE_CHECKING:
    from pdrbench_sim.radio.wlan import PropagationParams

LOST: Final = "LabStrideLost-v2"
WLAN: Final = "LabStrideWifi-v2"
RUNS: Final = 5  # W1: "we ran the filter a total of 5 times"
BAT_SIGMA_M: Final = 0.0123  # W1: 3 cm at 95 %, per axis
CORRECT_M: Final = 3.0  # ours: a cluster this near in plan, and
CORRECT_HEIGHT_M: Final = 1.5  # ours: in height, half way between levels, is the walker's
# W10: the paper names neither. Its prior determines epsilon (0.05, note 2 of the claims), its 170 particles while
# tracking delta: 0.01, 0.05 and 0.1 give 252, 181 and 156 on four train walks.
DELTA: Final = 0.05
FILTER: Final = {"kld_delta": DELTA}
TRACKING_BINS: Final = 36  # W15: at most 500 particles; a cluster in more bins is still a search
FOUR: Final = 4  # W14: strong access points of the paper's example
STARTS: Final = 25  # WLAN scans of one building, each at another stance of the walk
CROWD: Final = 20_000  # particles behind a check of the algorithm
NEAR_START_M: Final = 12.0  # of the floor on which the two filters are compared
CELL_M: Final = 2.0  # of their comparison
STRIDES_COMPARED: Final = 8
LEAK_M: Final = 1e-3  # a particle farther outside its polygon has passed through a wall; float32 resolves 8e-6 m here


@dataclass(frozen=True, slots=True)
class Run:
    """One run of the localizer over one walk, stride by stride.

    Attributes:
        prior_particles: Of the prior.
        error_m: (S,) horizontal, from where the foot rested.
        xy_m: (S, 2) estimates.
        height_m: (S,) of the floor polygon that the estimate stands on.
        height_error_m: (S,) its distance from the walker's; levels change half way up a flight and are too coarse.
        converged: (S,) bool; W16: where there is a single cluster, there is an estimate.
        num_particles: (S,) int.
        num_bins: (S,) int, that they occupy.
        deaths: How often every particle had hit a wall.
    """

    prior_particles: int
    error_m: FloatArray
    xy_m: FloatArray
    height_m: FloatArray
    height_error_m: FloatArray
    converged: BoolArray
    num_particles: IntArray
    num_bins: IntArray
    deaths: int

    @property
    def first(self) -> int:
        """Stride of the first convergence, from 0; the number of strides where there is none."""
        return int(np.argmax(self.converged)) if self.converged.any() else len(self.converged)

    @property
    def tracks(self) -> BoolArray:
        """(S,) True while it tracks: a single cluster, from where it occupies `TRACKING_BINS` or fewer.

        Not at the stride of convergence: its particles were drawn while it searched.
        """
        tracks = np.zeros(len(self.converged), dtype=np.bool_)
        for i in range(1, len(tracks)):
            is_single = self.converged[i - 1] and self.converged[i]
            tracks[i] = is_single and (self.num_bins[i] <= TRACKING_BINS or tracks[i - 1])
        return tracks

    def is_correct(self, stride: int) -> bool:
        """True where the estimate of a stride is the walker."""
        return stride < len(self.error_m) and bool(self.correct[stride])

    @property
    def correct(self) -> BoolArray:
        """(S,) True where the estimate is the walker."""
        correct: BoolArray = (self.error_m < CORRECT_M) & (self.height_error_m < CORRECT_HEIGHT_M)
        return correct


def run(
    recording: Recording,
    briefing: Briefing,
    rng: np.random.Generator,
    *,
    until_converged: bool = False,
    make: type[Woodman2008] = Woodman2008,
    **options: Any,
) -> Run:
    """Runs the localizer over the strides of a walk, without observations that change no estimate.

    Args:
        recording: The walk.
        briefing: What is given.
        rng: Of the localizer.
        until_converged: Stop at the first convergence.
        make: The localizer.
        options: Its parameters; `FILTER` is the paper's filter.
    """
    settings = {"debug_particles": 1, "filter": FILTER, "revises": False, **options}
    localizer = make(merged(WOODMAN2008, settings, "woodman2008"))
    localizer.reset(briefing, rng)
    nothing = {name: np.zeros((0, len(spec.columns))) for name, spec in briefing.sensors.items()}
    if "wifi" in briefing.sensors:
        localizer.step(Observation(0.0, {**nothing, "wifi": recording.streams["wifi"].rows}))
    prior_particles = int(localizer.debug()["num_particles"])
    found: list[tuple[float, ...]] = []
    for row in recording.streams["stride"].rows:
        estimate = localizer.step(Observation(float(row[0]), {**nothing, "stride": row[None]}))
        state = localizer.debug()
        stands_m = float(map_of(recording).height(state["estimate_polygon"]))
        counts = int(state["num_particles"]), int(state["num_bins"]), int(state["deaths"])
        found.append((*estimate.xy_m.tolist(), stands_m, bool(estimate.converged), *counts))
        if until_converged and estimate.converged:
            break
    x_m, y_m, height_m, converged, num_particles, num_bins, deaths = np.array(found).T
    xy_m, reference, rested = np.column_stack([x_m, y_m]), recording.reference, slice(1, len(found) + 1)
    assert reference.z_m is not None
    return Run(
        prior_particles=prior_particles,
        error_m=np.hypot(*(xy_m - reference.xy_m[rested]).T),
        xy_m=xy_m,
        height_m=height_m,
        height_error_m=np.abs(height_m - reference.z_m[rested]),
        converged=converged > 0,
        num_particles=num_particles.astype(np.int64),
        num_bins=num_bins.astype(np.int64),
        deaths=int(deaths[-1]),
    )


def _track(seed: int, *, learns_drift: bool) -> dict[str, Any]:
    """Five runs over one walk of 16 minutes from an unknown start (W1, W11, W15, W16)."""
    from pdrbench_lab.papers.woodman2008.lab_stride.lab import in_tracked_wing

    recording, briefing = walk_of(LOST, seed)
    rested_m, level = recording.reference.xy_m[1:], recording.reference.level[1:]
    in_wing = in_tracked_wing(map_of(recording), rested_m, level)
    bat_m = rested_m + np.random.default_rng([seed, RUNS]).normal(0.0, BAT_SIGMA_M, rested_m.shape)
    runs = [
        run(recording, briefing, np.random.default_rng([seed, number]), learns_drift=learns_drift)
        for number in range(RUNS)
    ]
    matched = [np.hypot(*(one.xy_m - bat_m)[one.converged & in_wing].T) for one in runs]
    found = [errors_m for errors_m, one in zip(matched, runs, strict=True) if one.is_correct(one.first)]
    return {
        "wing_error_m": np.concatenate(matched),
        "wing_error_found_m": np.concatenate([np.zeros(0), *found]),
        "num_pairs": sum(len(errors_m) for errors_m in matched),
        "error_m": np.concatenate([one.error_m[one.converged] for one in runs]),
        "prior_particles": [one.prior_particles for one in runs],
        "tracking_particles": np.concatenate([one.num_particles[one.tracks] for one in runs]),
        "converged_particles": np.concatenate([one.num_particles[one.converged] for one in runs]),
        **_convergence(runs),
        "correct_at_end": [one.is_correct(len(one.error_m) - 1) for one in runs],
        "correct_later": np.concatenate([one.correct[one.converged] for one in runs]),
        "deaths": [one.deaths for one in runs],
    }


def _converge(env: str, seed: int, runs: int = RUNS, **options: Any) -> dict[str, Any]:
    """Runs to convergence from one WLAN scan (W14, W16), or with heights that weigh nothing (W17)."""
    found = converge(*walk_of(env, seed), seed, runs, **options)
    return {"prior_particles": [one.prior_particles for one in found], **_convergence(found)}


def converge(recording: Recording, briefing: Briefing, seed: int, runs: int = RUNS, **options: Any) -> list[Run]:
    """Runs over one walk up to the first single cluster."""
    return [
        run(recording, briefing, np.random.default_rng([seed, number]), until_converged=True, **options)
        for number in range(runs)
    ]


# With the settings of the paper, and with the drift of the walk learned.
track, track_drift = (partial(_track, learns_drift=learns) for learns in (False, True))
track_wlan, track_wlan_drift = (partial(_converge, WLAN, learns_drift=learns) for learns in (False, True))
track_blind, track_blind_drift = (
    partial(_converge, LOST, learns_drift=learns, runs=1, use_height=False) for learns in (False, True)
)


def _convergence(runs: list[Run]) -> dict[str, Any]:
    """Strides to the first single cluster, and whether it was the walker; never is infinity and wrong."""
    return {
        "converged": [bool(one.converged.any()) for one in runs],
        "strides_to_converge": [one.first + 1 if one.converged.any() else math.inf for one in runs],
        "correct": [one.is_correct(one.first) for one in runs],
    }


def wlan_starts(seed: int) -> dict[str, Any]:
    """WLAN starts at many stances of one walk, doors open and closed at random (W13, W14)."""
    from pdrbench_lab.papers.woodman2008.lab_stride.environment import propagation

    return starts_of(seed, propagation())


def starts_of(seed: int, radio: PropagationParams, known_dbm: dict[bytes, FloatArray] | None = None) -> dict[str, Any]:
    """The same with access points and a receiver of one's own; receivers share what is known of a place."""
    from pdrbench_lab.papers.single_scans import receive, wifi_rows
    from pdrbench_lab.papers.woodman2008.shared_field import SharedField
    from pdrbench_lab.papers.woodman2008.survey import survey
    from pdrbench_sim.radio.wlan import make_radio_field

    recording, _ = walk_of(LOST, seed)
    building, reference = map_of(recording), recording.reference
    rng = np.random.default_rng([seed, 13])
    cells = divide(building)
    field = SharedField.of(make_radio_field(rng, building, params=radio), {} if known_dbm is None else known_dbm)
    radio_map = survey(rng, field, cells)
    visibility = VisibilityMap.from_radio_map(cells, radio_map)
    row = np.sort(rng.choice(len(reference), STARTS, replace=False))
    place = building.locate(reference.xy_m[row], reference.level[row]), reference.xy_m[row]
    doors_open = rng.random((STARTS, field.num_doors)) < 0.5
    t_s = 30.0 * np.arange(STARTS, dtype=np.float64)
    heading_rad = rng.uniform(-math.pi, math.pi, STARTS)
    scans = wifi_rows(field, t_s, receive(field, rng, t_s, *place, heading_rad, doors_open=doors_open))
    particles = WoodmanFilter(building, rng)
    counts, starts = [], []
    for scan in (scans[scans[:, 0] == moment_s] for moment_s in t_s):
        starts.append(visibility.start(scan[:, 1], scan[:, 2]))
        particles.start(starts[-1].region)
        counts.append(particles.num_particles)
    num_strong = np.array([len(start.used) + len(start.dropped) for start in starts])
    surveyed = cells.locate(radio_map.level, radio_map.xy_m)
    return {
        "particles": counts,
        "inside": [
            bool(start.region.contains(polygon, xy_m)[0]) for start, polygon, xy_m in zip(starts, *place, strict=True)
        ],
        "small": np.array(counts) <= 151_000,
        "num_strong": num_strong,
        "particles_of_four": np.array(counts)[num_strong == FOUR],
        "dropped": [len(start.dropped) > 0 for start in starts],
        "longest_cell_m": max(
            float(np.ptp(cells.region.corners_xy_m[cells.cell == cell].reshape(-1, 2), axis=0).max())
            for cell in range(cells.num_cells)
        ),
        "fewest_queries": int(np.bincount(surveyed, minlength=cells.num_cells).min()),
        "num_cells": cells.num_cells,
    }


def priors(seed: int) -> dict[str, Any]:
    """The prior with all headings and with a heading known to 10 degrees (W18), and what it is drawn on (W7, W10)."""
    recording, _ = walk_of(LOST, seed)
    building, rng = map_of(recording), np.random.default_rng([seed, 18])
    particles, whole = WoodmanFilter(building, rng), FloorRegion.whole(building)
    particles.start(whole)
    all_bins, needed, overshoot = particles.num_bins, particles.num_particles - particles.overshoot, particles.overshoot
    bound = kld_bound(all_bins, WoodmanFilterParams().kld_epsilon, normal_quantile(WoodmanFilterParams().kld_delta))
    known = HeadingPrior(math.radians(5), math.radians(5))
    particles.start(whole, known)
    known_bins, known_particles = particles.num_bins, particles.num_particles
    as_dense = round((needed + overshoot) / 36)
    particles = WoodmanFilter(building, rng, WoodmanFilterParams(min_particles=as_dense, max_particles=as_dense))
    particles.start(whole, known)
    kinds = [polygon.kind for polygon in building.polygons]
    return {
        "bins_ratio": all_bins / particles.num_bins,
        "drawn_bins_ratio": all_bins / known_bins,
        "known_heading_particles": known_particles,
        "particles_over_bound": needed / bound,
        "overshoot_fraction": overshoot / needed,
        "bins_per_m2": all_bins / 36 / building.area_m2,
        "area_m2": building.area_m2,
        "num_levels": len(building.levels),
        "num_polygons": len(building.polygons),
        "num_treads": kinds.count("stairs"),
    }


def one_stride(seed: int) -> dict[str, Any]:
    """What one stride does to many particles at one place, and many strides to many particles (W4, W6, W8)."""
    recording, _ = walk_of(LOST, seed)
    building, rng = map_of(recording), np.random.default_rng([seed, 4])
    treads = [i for i, polygon in enumerate(building.polygons) if polygon.kind == "stairs"]
    tread = int(rng.choice(treads))
    crowd = WoodmanFilterParams(min_particles=CROWD)
    level_walk = _after(building, rng, crowd, tread, HeadingPrior(0.0, 0.0), (1.3, 0.0, 0.5))
    offset_m = level_walk.xy_m - building.polygons[tread].outline_xy_m.mean(axis=0)
    turn_rad = wrap_rad(level_walk.heading_rad - 0.5)
    back = _after(building, rng, crowd, tread, HeadingPrior(0.0, 0.0), (0.0, 0.0, 0.0)).xy_m
    climbed = _after(building, rng, crowd, tread, HeadingPrior(), (1.0, 0.3, 0.0))
    return {
        "length_sigma_m": float(np.std(offset_m @ [math.cos(0.5), math.sin(0.5)])),
        "turn_sigma_deg": math.degrees(float(np.std(turn_rad))),
        "fraction_backwards": float((back[:, 0] < building.polygons[tread].outline_xy_m.mean(axis=0)[0]).mean()),
        "weight_off_by": _weight_off_by(building, climbed, tread),
        **_leaks(recording, rng),
    }


def _after(
    building: Building,
    rng: np.random.Generator,
    params: WoodmanFilterParams,
    polygon: int,
    heading: HeadingPrior,
    stride: tuple[float, float, float],
) -> ParticleCloud:
    """Particles that stood in the middle of a convex polygon, one stride later."""
    x_m, y_m = building.polygons[polygon].outline_xy_m.mean(axis=0)
    corners = np.array([[[x_m, y_m], [x_m + 1e-4, y_m], [x_m, y_m + 1e-4]]])
    particles = WoodmanFilter(building, rng, params)
    particles.start(FloorRegion(corners, np.array([polygon])), heading)
    particles.update(*stride)
    return particles.cloud()


def _weight_off_by(building: Building, cloud: ParticleCloud, begun_in: int) -> float:
    """Largest relative difference between the weights of the live and eq. (16), up to a common factor.

    In the fast filter no height weighs less than exp(-`MAX_EXPONENT`), at 12.6 sigma.
    """
    alive = cloud.weight > 0
    rise_m = building.height(cloud.polygon[alive]) - building.height(begun_in)
    ratio = cloud.weight[alive] / np.exp(-np.minimum(0.5 * ((0.3 - rise_m) / 0.1) ** 2, MAX_EXPONENT))
    return float(np.ptp(ratio) / ratio.mean()) if alive.any() else math.nan


def _leaks(recording: Recording, rng: np.random.Generator) -> dict[str, Any]:
    """Live particles outside the polygon that they carry, over the strides of a walk."""
    import shapely

    from pdrbench.building.polygons import shapely_polygons

    building = map_of(recording)
    outlines = shapely_polygons(building.polygons)
    shapely.prepare(outlines)
    particles, num_looked_at, num_outside = WoodmanFilter(building, rng), 0, 0
    particles.start(FloorRegion.whole(building))
    for stride in recording.streams["stride"].rows[:40, 1:].tolist():
        particles.update(*stride)
        if particles.is_depleted:
            break
        cloud = particles.cloud(CROWD)
        alive = cloud.weight > 0
        near = shapely.dwithin(outlines[cloud.polygon[alive]], shapely.points(cloud.xy_m[alive]), LEAK_M)
        num_looked_at, num_outside = num_looked_at + len(near), num_outside + int((~near).sum())
    return {"looked_at": num_looked_at, "outside": num_outside}


def agreement(seed: int) -> dict[str, Any]:
    """The fast filter against the literal one, from the same floor over the same strides (W9).

    The distance of two clouds is half the sum of |p - q| over cells of 2 m, levels and eight headings. Two literal
    runs differ by chance; the fast one should differ from either by no more.
    """
    recording, _ = walk_of(LOST, seed)
    building, reference = map_of(recording), recording.reference
    floor = FloorRegion.whole(building)
    centre_m = floor.corners_xy_m.mean(axis=1)
    near = np.hypot(*(centre_m - reference.xy_m[0]).T) < NEAR_START_M
    region = floor.restricted(near & (building.level(floor.polygon) == reference.level[0]))
    fractions, counts, overshoot = [], [], []
    kinds: tuple[Any, ...] = (LiteralFilter, LiteralFilter, WoodmanFilter)
    for number, make in enumerate(kinds):
        particles = make(building, np.random.default_rng([seed, number]))
        particles.start(region)
        for stride in recording.streams["stride"].rows[:STRIDES_COMPARED, 1:].tolist():
            particles.update(*stride)
            overshoot.append(particles.overshoot / particles.num_particles)
        fractions.append(_fractions(particles.cloud(), building))
        counts.append(particles.num_particles)
    one, other, fast = fractions
    by_chance = _distance(one, other)
    return {
        "distance_ratio": 0.5 * (_distance(one, fast) + _distance(other, fast)) / by_chance,
        "distance_by_chance": by_chance,
        "overshoot_fraction": max(overshoot),
        "particles_ratio": 2 * counts[2] / (counts[0] + counts[1]),
    }


def _fractions(cloud: ParticleCloud, building: Building) -> pd.Series:
    """Of the weight, by cell, level and eighth of a turn."""
    eighth = np.floor(np.mod(cloud.heading_rad, 2 * math.pi) / (math.pi / 4))
    weight = pd.Series(cloud.weight).groupby([*np.floor(cloud.xy_m.T / CELL_M), building.level(cloud.polygon), eighth])
    fractions: pd.Series = weight.sum() / cloud.weight.sum()
    return fractions


def _distance(one: pd.Series, other: pd.Series) -> float:
    return 0.5 * float(one.sub(other, fill_value=0.0).abs().sum())


def throughput(seed: int) -> dict[str, Any]:
    """Particles that are resampled, propagated and corrected in 1.1 s by one thread (W12).

    Median over the first strides from the prior over the whole floor, without the first, which compiles.
    """
    recording, _ = walk_of(LOST, seed)
    building, per_stride = map_of(recording), {}
    for name, make in FILTERS.items():
        particles = make(building, np.random.default_rng(0))
        particles.start(FloorRegion.whole(building))
        rates = []
        for stride in recording.streams["stride"].rows[:5, 1:].tolist():
            began_s = time.perf_counter()
            particles.update(*stride)
            rates.append(1.1 * particles.num_particles / (time.perf_counter() - began_s))
        per_stride[f"{name}_per_stride"] = float(np.median(rates[1:]))
    return per_stride
