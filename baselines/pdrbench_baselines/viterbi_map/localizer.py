"""`viterbi_map`: the displacements of `learned` through a hidden Markov model on the map.

Z. Xiao, H. Wen, A. Markham, N. Trigoni, "Lightweight map matching for indoor localisation using conditional random
fields", IPSN 2014, match a trajectory to a graph of the floor in such a way. Here what a walk keeps, the length of its
steps and the error of its heading, is part of the state, and a path may pass a wall at a price.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.localizer import LearnedMap, LearnedMapParams
from pdrbench_baselines.learned.reckoning import Move
from pdrbench_baselines.learned.signals import turned
from pdrbench_baselines.viterbi_map.trellis import Trellis, TrellisParams

EVERY_S: Final = 0.2  # between rows of the revised past: a second is a metre


@dataclass(frozen=True, slots=True)
class ViterbiMapParams:
    """Defaults, ours; both factors were set on 24 train walks of recorded malls.

    Attributes:
        trellis: States and their transitions.
        lag_s: Seconds after which the revised past is final, for walks without end; infinite: it is kept whole.
        takes_likeliest: The revised past is the likeliest path (Viterbi), which has no spread; else the mean over the
            paths of all survivors.
        sigma_factor: By which the spread of survivors is multiplied for `sigma_m`: what is wrong with a map, or with
            all displacements alike, does not spread them.
        revised_sigma_factor: The same of the revised past, where few paths are left.
    """

    trellis: TrellisParams = field(default_factory=TrellisParams)
    lag_s: float = math.inf
    takes_likeliest: bool = False
    sigma_factor: float = 2.4
    revised_sigma_factor: float = 4.0


VITERBI_MAP: Final = ViterbiMapParams()


class ViterbiMap(LearnedMap):
    """`learned` displacements on the plan by a Viterbi search; needs what `learned_map` needs.

    Args:
        params: See `ViterbiMapParams`.
    """

    def __init__(self, params: ViterbiMapParams = VITERBI_MAP) -> None:
        super().__init__(LearnedMapParams(sigma_factor=params.sigma_factor, revises=False))
        self._own = params

    def revise(self) -> FloatArray | None:
        """(K, 5) t_s, x_m, y_m, level, sigma_m, five rows a second; None where the walk never began."""
        trellis = self._trellis
        if trellis is None:
            return None
        rows = trellis.path(takes_likeliest=self._own.takes_likeliest)
        rows[:, 4] = np.maximum(self._own.revised_sigma_factor * rows[:, 4], self._own.trellis.square_m / 2)
        return _between(rows)

    def debug(self) -> dict[str, NDArray[Any]]:
        """Survivors and their weights, how often all had died, the mean factor on lengths and error of headings."""
        trellis = self._trellis
        return super().debug() | ({} if trellis is None else {"particles_weight": trellis.fraction})

    @property
    def _trellis(self) -> Trellis | None:
        return cast("Trellis | None", self._filter)

    def _new_filter(self, level: int) -> Any:
        own = self._own
        return Trellis(self._building, self._rng, own.trellis, level, lag_s=own.lag_s)

    def _walk(self, cloud: Any, move: Move) -> None:
        if move.stands:
            cloud.stay(move.end_s)
        else:
            cloud.move(move.move_m, move.covariance_m2, move.end_s)
        self._follow(cloud.mean_scale * turned(move.move_m, cloud.mean_bias_rad), move.end_s)


def _between(rows: FloatArray) -> FloatArray:
    """Rows `EVERY_S` apart, on lines between those of whole seconds; the level is that of the last one."""
    if len(rows) < 2:
        return rows
    t_s = np.unique(np.concatenate([np.arange(rows[0, 0], rows[-1, 0], EVERY_S), rows[:, 0]]))
    last = np.searchsorted(rows[:, 0], t_s, side="right") - 1
    x_m, y_m, sigma_m = (np.interp(t_s, rows[:, 0], rows[:, column]) for column in (1, 2, 4))
    return np.column_stack([t_s, x_m, y_m, rows[last, 3], sigma_m])
