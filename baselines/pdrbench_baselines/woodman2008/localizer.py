"""Woodman & Harle 2008: a foot-mounted unit, a detailed map and a particle filter find a walker, and track them.

O. Woodman, R. Harle, "Pedestrian localisation for indoor environments", UbiComp 2008.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building, FloorRegion
from pdrbench.building.building import NOWHERE
from pdrbench.errors import PdrbenchError, UnsuitableError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.radio.cells import divide
from pdrbench.trajectory import Start
from pdrbench_baselines.backward import BackwardSampler, StoredCloud, Transition, gaussian
from pdrbench_baselines.woodman2008.clusters import cluster
from pdrbench_baselines.woodman2008.discs import floor_around, floor_from
from pdrbench_baselines.woodman2008.drift import DriftParams, TurnDrift
from pdrbench_baselines.woodman2008.map_filter import FEW, WoodmanFilter
from pdrbench_baselines.woodman2008.params import HeadingPrior, WoodmanFilterParams
from pdrbench_baselines.woodman2008.visibility import VisibilityMap

GUESS_PARTICLES: Final = 2000  # of a cloud in too many bins; enough to find where most of it is
KEPT_PARTICLES: Final = 2000  # of a cloud, to draw lines through; a converged one has fewer
MAX_STORED: Final = 2**21  # particles of all clouds
KEPT_M: Final = 0.1  # how far apart those kept are, about: what a line may miss a particle by
KEPT_RAD: Final = math.radians(2.0)
MANY_PARTICLES: Final = 50_000  # the filter has kernels of its own for them


@dataclass(frozen=True, slots=True)
class Woodman2008Params:
    """Defaults from Woodman & Harle 2008 unless a line says otherwise.

    Attributes:
        filter: Noise, bins and numbers of particles.
        use_height: False: heights of strides weigh nothing (W17).
        use_wifi: False: the first scan is ignored, the prior is the whole floor.
        wifi_threshold_dbm: A stronger access point would have been sighted by the survey of the walker's cell.
        cell_edge_m: Longest edge of a cell of the survey.
        cluster_eps_m: Particles nearer than that belong to one cluster.
        most_bins: A cloud that occupies more bins is many places, whatever its clusters.
        most_sigma_m: A cluster that is wider, per axis, is no single place.
        steady_strides: Strides for which a single place has to stand before it is believed; not after a known start.
        start_radius_m: A known start is a disc of at least this radius.
        start_heading_rad: Half the width of the headings around a known one.
        restart_radius_m: Of the disc in which a depleted cloud is drawn again; doubled with each depletion in a row.
        restart_strides: Depletions are in a row where fewer strides than that lie between two of them.
        debug_particles: Largest number of particles that `debug` returns.
        learns_drift: Beyond the paper: what foot-mounted units do is taken into account; see `DriftParams`.
        drift: How, where it is.
        revises: Whether clouds are kept, from which `revise` draws the past.
    """

    filter: WoodmanFilterParams = field(default_factory=WoodmanFilterParams)
    use_height: bool = True
    use_wifi: bool = True
    wifi_threshold_dbm: float = -75.0
    cell_edge_m: float = 8.0
    cluster_eps_m: float = 2.0  # W16
    most_bins: int = 400  # ours: tracking occupies 8, at most 31 (W15)
    most_sigma_m: float = 2.0  # ours: by chains of 2 m a crowded floor, or the prior, is one cluster
    steady_strides: int = 1  # ours
    start_radius_m: float = 0.5  # ours
    start_heading_rad: float = math.radians(5)  # ours; "known to within 10°"
    restart_radius_m: float = 3.0  # ours
    restart_strides: int = 30  # ours
    debug_particles: int = 20_000  # ours
    learns_drift: bool = False
    drift: DriftParams = field(default_factory=DriftParams)
    revises: bool = True

    def __post_init__(self) -> None:
        lengths = ("cell_edge_m", "cluster_eps_m", "most_sigma_m", "start_radius_m", "restart_radius_m")
        for name in lengths:
            if not getattr(self, name) > 0:
                raise PdrbenchError(f"woodman2008: {name} must be positive; got {getattr(self, name)!r}")

    def of_filter(self, *, searching: bool = False) -> WoodmanFilterParams:
        """What the filter is set to, heights switched off where they are not used."""
        params = self.drift.search if searching and self.learns_drift else self.filter
        return params if self.use_height else dataclasses.replace(params, height_sigma_m=math.inf)


WOODMAN2008: Final = Woodman2008Params()


class Woodman2008:
    """Localises from strides and a map alone; a known start or one WLAN scan narrows the prior down.

    While several clusters of particles stand, it answers the heaviest and says that it has not converged. Where every
    particle has hit a wall, it draws a new cloud. Once it has converged: in a disc around the last estimate, on the
    floor that is near by walking, all headings, the radius doubled for each depletion until it converges again. Before:
    where it began, and from the second depletion in a row on the whole floor. `debug` counts them as `deaths`.

    Without a known start it begins with the first WLAN scan where there is a survey, with the first stride where the
    scan comes later, and answers the middle of the building until then.

    `revise` gives the past by lines through the clouds. The cloud of a walker who was still sought is large: of each,
    some thousand particles are kept. Lines begin with the cloud that was drawn last, the prior or that of a restart.

    Args:
        params: See `Woodman2008Params`.
    """

    def __init__(self, params: Woodman2008Params = WOODMAN2008) -> None:
        self._params = params

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("stride",))
        if briefing.building is None:
            raise UnsuitableError("needs a building; this environment has no map")
        self._building = building = briefing.building
        new_filter = self._filter_type()
        _warm_up(building, self._params, new_filter)
        self._filter = new_filter(building, rng, self._params.of_filter(searching=True))
        p, drift = self._params, self._params.drift
        self._drift = TurnDrift(0.0, drift.sigma_rad if p.learns_drift else 0.0, drift.turn_sigma_rad)
        self._length_scale = drift.length_scale if p.learns_drift else 1.0
        self._steady_strides = drift.steady_strides if p.learns_drift else p.steady_strides
        self._rng, self._last_s = rng, 0.0
        self._past = BackwardSampler(KEPT_PARTICLES, MAX_STORED) if p.revises else None
        self._heading_rad: float | None = None
        self._region = FloorRegion.whole(building)
        self._heading: HeadingPrior | None = None
        self._depletions, self._depletions_in_a_row, self._strides_alive, self._single_strides = 0, 0, 0, 0
        self._has_converged, self._is_believed = False, briefing.start is not None
        self._visibility = self._survey(briefing)
        self._scan: FloatArray = np.zeros((0, 5))
        self._walks = False
        centre = building.centre()
        self._estimate = Estimate(centre.xy_m, centre.level, sigma_m=centre.radius_m / 2, converged=False)
        if briefing.start is not None:
            self._start(*self._around(briefing.start))
        elif self._visibility is None:
            self._start(self._region)

    def step(self, observation: Observation) -> Estimate:
        self._look(observation)
        for t_s, length_m, height_m, turn_rad in observation["stride"].tolist():
            if self._past is None:
                self._stride(length_m, height_m, turn_rad)
            else:
                self._stride_stored(self._past, t_s, length_m, height_m, turn_rad)
        return self._estimate if self._past is None else self._past.answered(observation.now_s, self._estimate)

    def revise(self) -> FloatArray | None:
        """(K, 5) t_s, x_m, y_m, level, sigma_m at the times of the answers; None where no clouds were kept."""
        return None if self._past is None else self._past.revised(self._rng.spawn(1)[0])

    def debug(self) -> dict[str, NDArray[Any]]:
        """The particles, at most `debug_particles` of them, and the counts of the last stride."""
        cloud = self._filter.cloud(self._params.debug_particles)
        return {
            "particles_xy_m": cloud.xy_m,
            "particles_level": self._building.level(cloud.polygon),
            "particles_polygon": cloud.polygon,
            "particles_heading_rad": cloud.heading_rad,
            "particles_weight": cloud.weight,
            "estimate_polygon": np.array(self._clusters.polygon[0] if self._filter.num_particles else NOWHERE),
            "num_particles": np.array(self._filter.num_particles),
            "num_bins": np.array(self._filter.num_bins),
            "num_clusters": np.array(len(self._clusters) if self._filter.num_particles else 0),
            "converged": np.array(bool(self._estimate.converged)),
            "deaths": np.array(self._depletions),
        }

    def _filter_type(self) -> Callable[..., Any]:
        return WoodmanFilter

    def _stride(self, length_m: float, height_m: float, turn_rad: float) -> None:
        self._update(length_m, height_m, turn_rad)
        if self._filter.is_depleted:
            self._restart()
        else:
            self._strides_alive += 1
            self._locate()
            self._learn(turn_rad)

    def _update(self, length_m: float, height_m: float, turn_rad: float) -> None:
        """Algorithm 1 for one stride: resample, propagate, correct; with settings of its own while it searches."""
        p = self._params
        if not self._filter.num_particles:
            self._start(self._region)
        self._walks = True
        if p.learns_drift:
            self._filter.adjust(p.of_filter(searching=not self._is_believed))
        self._filter.update(self._length_scale * length_m, height_m, turn_rad - self._drift.mean_rad)

    def _learn(self, turn_rad: float) -> None:
        """Updates the drift by how much less the cloud has turned than the stride reported, while it is converged."""
        before_rad = self._heading_rad
        self._heading_rad = self._estimate.heading_rad if self._estimate.converged else None
        if before_rad is not None and self._heading_rad is not None:
            self._drift = self._drift.observed(turn_rad, self._heading_rad - before_rad)

    def _around(self, start: Start) -> tuple[FloorRegion, HeadingPrior | None]:
        """The disc and the headings of a known start."""
        radius_m = max(start.radius_m, self._params.start_radius_m)
        region = floor_around(self._building, start.xy_m, start.level, radius_m)
        if start.heading_rad is None:
            return region, None
        return region, HeadingPrior(start.heading_rad, self._params.start_heading_rad)

    def _survey(self, briefing: Briefing) -> VisibilityMap | None:
        """The visible regions of the access points (eq. 17, 18), where the first scan narrows the prior down."""
        survey, is_used = briefing.radio_map, self._params.use_wifi and "wifi" in briefing.sensors
        if survey is None or briefing.start is not None or not is_used:
            return None
        return VisibilityMap.from_radio_map(divide(self._building, self._params.cell_edge_m), survey)

    def _look(self, observation: Observation) -> None:
        """Starts in the region of the first scan (eq. 19), again where more of it arrives before the first stride."""
        if self._visibility is None or self._walks:
            return
        scan = np.concatenate([self._scan, observation["wifi"]])
        scan = scan[scan[:, 0] == scan[:1, 0]]
        if len(scan) > len(self._scan):
            self._scan = scan
            _, access_point, rssi_dbm, _, _ = scan.T
            self._start(self._visibility.start(access_point, rssi_dbm, self._params.wifi_threshold_dbm).region)

    def _start(self, region: FloorRegion, heading: HeadingPrior | None = None) -> None:
        """Draws the prior."""
        self._region, self._heading = region, heading
        self._filter.start(region, heading)
        self._locate()

    def _restart(self) -> None:
        """Draws a new cloud where every particle has hit a wall; see the class."""
        if self._strides_alive >= self._params.restart_strides:
            self._depletions_in_a_row = 0
        self._depletions, self._strides_alive, self._single_strides = self._depletions + 1, 0, 0
        self._is_believed, self._heading_rad = False, None
        if self._has_converged:
            radius_m = self._params.restart_radius_m * 2.0**self._depletions_in_a_row
            last = self._clusters
            self._filter.start(floor_from(self._building, int(last.polygon[0]), last.xy_m[0], radius_m))
            self._estimate = dataclasses.replace(self._estimate, sigma_m=radius_m / 2, converged=False)
        elif self._depletions_in_a_row:
            self._start(FloorRegion.whole(self._building))
        else:
            self._start(self._region, self._heading)
        self._depletions_in_a_row += 1

    def _locate(self) -> None:
        """Weighted mean of the heaviest cluster (eq. 20, 21); converged where there is no other, and it is small."""
        params = self._params
        is_many = self._filter.num_bins > params.most_bins
        cloud = self._filter.cloud(GUESS_PARTICLES if is_many else None)
        self._clusters = clusters = cluster(cloud, self._building, params.cluster_eps_m)
        is_single = not is_many and len(clusters) == 1 and bool(clusters.sigma_m[0] <= params.most_sigma_m)
        self._single_strides = self._single_strides + 1 if is_single else 0
        self._is_believed |= self._single_strides >= self._steady_strides
        self._has_converged |= is_single and self._is_believed
        self._estimate = Estimate(
            xy_m=clusters.xy_m[0],
            level=int(self._building.level(clusters.polygon[0])),
            heading_rad=float(clusters.heading_rad[0]),
            sigma_m=clusters.total_sigma_m,
            converged=is_single and self._is_believed,
        )

    def _stride_stored(
        self, past: BackwardSampler, t_s: float, length_m: float, height_m: float, turn_rad: float
    ) -> None:
        """One stride, which ended then, and its cloud."""
        if not len(past) and self._filter.num_particles:
            past.follow(self._stored(self._last_s), self._last_s)
        depletions, transition = self._depletions, self._transition(length_m, turn_rad - self._drift.mean_rad)
        self._stride(length_m, height_m, turn_rad)
        is_first = not len(past) or self._depletions > depletions
        past.follow(self._stored(t_s), self._last_s, None if is_first else transition)
        self._last_s = t_s

    def _stored(self, t_s: float) -> StoredCloud:
        cloud = self._filter.cloud(KEPT_PARTICLES)
        heading = np.cos(cloud.heading_rad), np.sin(cloud.heading_rad)
        level = self._building.level(cloud.polygon)
        weight = np.where(cloud.weight.any(), cloud.weight, 1.0)
        return StoredCloud(t_s, np.column_stack([cloud.xy_m, *heading]), level, cloud.polygon, weight, self._is_free)

    def _is_free(self, from_xy_m: FloatArray, polygon: IntArray, to_xy_m: FloatArray) -> BoolArray:
        return self._building.move(polygon, from_xy_m, to_xy_m)[1]

    def _transition(self, length_m: float, turn_rad: float) -> Transition:
        p = self._params.of_filter(searching=not self._is_believed)
        scaled_m, cosine, sine = self._length_scale * length_m, math.cos(turn_rad), math.sin(turn_rad)
        place_m = math.hypot(p.length_sigma_m, p.heading_sigma_rad * scaled_m, KEPT_M)
        covariance = np.diag(np.square([place_m, place_m, *[math.hypot(p.heading_sigma_rad, KEPT_RAD)] * 2]))

        def expected(state: FloatArray) -> FloatArray:
            x, y = state[:, 2], state[:, 3]
            heading = np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
            return np.column_stack([state[:, :2] + scaled_m * heading, heading])

        return gaussian(expected, covariance)


def _warm_up(building: Building, params: Woodman2008Params, new_filter: Callable[..., Any]) -> None:
    """Compiles, and derives from the map, what strides would otherwise wait for; on clouds of their own."""
    region = FloorRegion.whole(building)
    largest = np.arange(len(region)) == np.argmax(region.triangle_area_m2())
    for num_particles in (params.filter.min_particles, MANY_PARTICLES):
        least = min(num_particles, params.filter.max_particles)
        most = min(params.filter.max_particles, max(least, FEW))  # or no trial would be of few particles
        settings = dataclasses.replace(params.filter, min_particles=least, max_particles=most)
        trial = new_filter(building, np.random.default_rng(0), settings)
        trial.start(region.restricted(largest))
        trial.update(0.0, 0.0, 0.0)
    clusters = cluster(trial.cloud(GUESS_PARTICLES), building, params.cluster_eps_m)
    floor_from(building, int(clusters.polygon[0]), clusters.xy_m[0], params.restart_radius_m)
