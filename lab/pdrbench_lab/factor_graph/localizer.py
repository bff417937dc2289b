"""`factor_graph`: displacements of `learned`, a survey and the plan as one least-squares problem over time.

F. Dellaert, M. Kaess, "Factor graphs for robot perception", Foundations and Trends in Robotics 6, 2017. A fixed-lag
smoother answers while the walk goes on; `revise` solves the whole walk when it is over.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_baselines.fusion.radio import RadioEvidence
from pdrbench_baselines.gp_wifi.localizer import GpWifiParams
from pdrbench_baselines.learned.base import NetworkLocalizer
from pdrbench_baselines.learned.reckoning import EVERY_S, Move
from pdrbench_baselines.learned.signals import turned
from pdrbench_lab.factor_graph.radio import ScanGrids
from pdrbench_lab.factor_graph.walls import Distances, distances_of, stairs_of
from pdrbench_lab.factor_graph.window import Smoothed, Window, WindowParams

ROWS_EVERY_S: Final = 0.2  # of the revised past: a second is a metre


@dataclass(frozen=True, slots=True)
class FactorGraphParams:
    """Defaults, ours; the notebook has what was measured.

    Attributes:
        window: Of the graph.
        square_m: Side of the squares on which distances to walls are kept.
        uses_walls: Whether walls count where there is a map.
        uses_radio: Whether scans count where there is a survey.
        radio: Of the radio map.
        map_error_m: By which that is off, per axis, as `FusionParams`.
        trust: Power of the likelihood of a scan, over that of `gp_wifi`: neighbouring scans err alike.
        drawn_trust: The same of a survey whose places were interpolated between surveyed ones.
        sigma_factor, revised_sigma_factor: On deviations, for `sigma_m`, on the way and of the revised past.
        sigma_floor_m: Added in squares: references and plans are off by as much.
        num_revisions: Iterations over the whole walk, at most.
        revises: Whether the whole walk is kept, for `revise`.
    """

    window: WindowParams = field(default_factory=WindowParams)
    square_m: float = 0.2
    uses_walls: bool = True
    uses_radio: bool = True
    radio: GpWifiParams = field(default_factory=GpWifiParams)
    map_error_m: float = 5.0
    trust: float = 0.5
    drawn_trust: float = 0.1
    sigma_factor: float = 2.0
    revised_sigma_factor: float = 2.4
    sigma_floor_m: float = 0.3
    num_revisions: int = 30
    revises: bool = True


FACTOR_GRAPH: Final = FactorGraphParams()


class FactorGraph(NetworkLocalizer):
    """Least squares over the last seconds of a walk; see `Window`.

    Needs what `learned` needs of a phone, a known start among it: from a wrong place least squares does not find the
    right one. A map makes walls count and a survey makes scans count; with neither this is dead reckoning.

    Args:
        params: See `FactorGraphParams`.
    """

    def __init__(self, params: FactorGraphParams = FACTOR_GRAPH) -> None:
        super().__init__()
        self._own = params
        self._radio: RadioEvidence | None = None

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(start=True)
        assert briefing.start is not None
        self._begin(briefing)
        self._building, start = briefing.building, briefing.start
        self._radio = self._fitted(briefing)
        self._grids = None if self._radio is None else ScanGrids(self._radio)
        self._floors: dict[int, Distances] = {}
        self._begins_s: list[float] = []
        self._know_floors(np.array([start.level]))
        stairs = self._stairs()
        self._window = Window(self._own.window, self._floors, stairs, self._grids, remembers=self._own.revises)
        sigma_m = max(self._own.window.chain.start_sigma_m, start.radius_m / 2)
        self._window.begin(np.array(start.xy_m), start.level, sigma_m)

    def step(self, observation: Observation) -> Estimate:
        window = self._window
        for move in self._reckoner.update(observation.rows):
            self._walk(move)
        if self._radio is not None and self._grids is not None:
            for log_likelihood in self._radio.update(observation["wifi"]):
                window.receive(self._grids.scan(log_likelihood))
        if self._has_level_changes and len(observation["level_change"]):
            self._change_level(int(observation["level_change"][:, 1].sum()))
        state, deviation_m = window.last()
        return Estimate(
            xy_m=state[:2] + self._extrapolated_m(observation.now_s),
            level=window.level,
            heading_rad=self._heading_rad,
            sigma_m=float(np.hypot(self._own.sigma_factor * deviation_m, self._own.sigma_floor_m)),
        )

    def revise(self) -> FloatArray | None:
        """(K, 5) t_s, x_m, y_m, level, sigma_m, five rows a second; None where the walk was not kept."""
        if not self._own.revises:
            return None
        own = self._own
        xy_m, deviation_m, level = _mean(self._window.smoothed(own.num_revisions))
        sigma_m = np.hypot(own.revised_sigma_factor * deviation_m, own.sigma_floor_m)
        return _rows(np.array(self._begins_s), xy_m, level, sigma_m)

    def debug(self) -> dict[str, NDArray[Any]]:
        """Last places of all chains with their fractions of the evidence, and the mean scale and heading bias."""
        window = self._window
        state, _ = window.last()
        return {
            "particles_xy_m": window.chains.state[:, -1, :2],
            "particles_level": window.chains.level[:, -1],
            "particles_weight": window.fraction,
            "num_particles": np.array(len(window.fraction)),
            "scale": np.array(float(np.exp(state[3]))),
            "bias_rad": np.array(float(state[2])),
        }

    def _fitted(self, briefing: Briefing) -> RadioEvidence | None:
        """The survey of a briefing; the one of the walk before where that is the same."""
        radio_map = briefing.radio_map
        if not self._own.uses_radio or radio_map is None or not len(radio_map.age_s) or "wifi" not in briefing.sensors:
            return None
        radio = self._radio
        if radio is None or radio.radio_map is not radio_map or radio.building is not self._building:
            radio = RadioEvidence(radio_map, self._building, self._own.radio, self._own.map_error_m)
        radio.begin(self._own.trust if radio_map.surveyed else self._own.drawn_trust)
        return radio

    def _know_floors(self, level: IntArray) -> None:
        """Distances to the walls of these levels, and scans there from now on."""
        if self._building is not None and self._own.uses_walls:
            for one in set(level.tolist()) - set(self._floors):
                self._floors[one] = distances_of(self._building, one, self._own.square_m)
        if self._radio is not None and self._floors:
            self._radio.focus(self._floors, np.ones(len(self._radio.prior), dtype=np.bool_))

    def _stairs(self) -> Mapping[tuple[int, int], Distances]:
        """That chains may take: none where there is no map, or where a sensor says when a level changes."""
        if self._building is None or not self._own.uses_walls or self._has_level_changes:
            return {}
        stairs = stairs_of(self._building, self._own.square_m)
        self._know_floors(np.array([after for _, after in stairs], dtype=np.int64))
        return stairs

    def _walk(self, move: Move) -> None:
        if not move.stands:
            self._window.move(move.move_m, move.covariance_m2)
            self._begins_s.append(move.end_s - EVERY_S)
        state, _ = self._window.last()
        self._follow(float(np.exp(state[3])) * turned(move.move_m, float(state[2])), move.end_s)

    def _change_level(self, levels: int) -> None:
        """The last place is so many levels higher, of those that the building has."""
        last = self._window.chains.level[:, -1]
        now = last + levels
        if self._building is not None:
            known = np.array(self._building.levels)
            now = known[np.clip(np.searchsorted(known, last) + levels, 0, len(known) - 1)]
        self._know_floors(now)
        self._window.change_level(now)


def _mean(chains: list[Smoothed]) -> tuple[FloatArray, FloatArray, IntArray]:
    """Mean (T, 2) and deviation (T,) over the chains that are on the likeliest level at each time, and that level."""
    fraction = np.array([chain.fraction for chain in chains])[:, None]
    level = np.stack([chain.level for chain in chains])
    levels = np.unique(level)
    support = np.stack([(fraction * (level == one)).sum(axis=0) for one in levels])
    likeliest = levels[np.argmax(support, axis=0)]
    weight = fraction * (level == likeliest)
    weight = weight / weight.sum(axis=0)
    xy_m = np.stack([chain.xy_m for chain in chains])
    mean_m = np.einsum("pt,ptk->tk", weight, xy_m)
    variance_m2 = np.square(np.stack([chain.sigma_m for chain in chains]))
    variance_m2 = variance_m2 + np.square(xy_m - mean_m).sum(axis=2) / 2.0
    return mean_m, np.sqrt((weight * variance_m2).sum(axis=0)), likeliest


def _rows(begins_s: FloatArray, xy_m: FloatArray, level: IntArray, sigma_m: FloatArray) -> FloatArray:
    """(K, 5) between states (T + 1,), of which each but the first ends a second (T,) of walking; one stands between."""
    if not len(begins_s):
        return np.array([[0.0, *xy_m[0], level[0], sigma_m[0]]])
    # a state holds until the next second begins, and is reached when that ends
    knots_s = np.column_stack([begins_s, np.append(begins_s[1:], np.inf)])
    ends_s = np.minimum(begins_s + EVERY_S, knots_s[:, 1])
    at_s = np.concatenate([begins_s, ends_s])
    state = np.concatenate([np.arange(len(begins_s)), np.arange(1, len(begins_s) + 1)])
    order = np.lexsort((state, at_s))
    at_s, state = at_s[order], state[order]
    t_s = np.unique(np.concatenate([[0.0], np.arange(at_s[0], at_s[-1], ROWS_EVERY_S), at_s]))
    t_s = t_s[t_s >= 0.0]
    x_m, y_m, deviation_m = (np.interp(t_s, at_s, part[state]) for part in (xy_m[:, 0], xy_m[:, 1], sigma_m))
    last = state[np.maximum(np.searchsorted(at_s, t_s, side="right") - 1, 0)]
    return np.column_stack([t_s, x_m, y_m, level[last], deviation_m])
