"""Distances and turns of the localizers of this package, as `learned.walks` measures those of a network.

Lengths are summed from answer to answer. A localizer that extrapolates between the seconds of its network, as
`learned` does, comes out too long by that: measure it with `measure`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from pdrbench.localizer import Briefing, Localizer, Observation
from pdrbench.recording import Recording
from pdrbench.trajectory import Start
from pdrbench_lab.learned.walks import USED, Reckoned, reckoned_figures

PERIOD_S: Final = 1.0
KEYS: Final = ("distance_pct", "bias_pct", "generic_pct", "turn_p95_deg")


def played(localizer: Localizer, recording: Recording, seed: int = 0) -> Reckoned:
    """What a localizer estimates second by second of the sensors of one walk, from the origin, without a map."""
    names = [name for name in USED if name in recording.streams]
    specs = {name: recording.streams[name].spec for name in names}
    start = Start(xy_m=np.zeros(2), level=0)
    briefing = Briefing(None, specs, PERIOD_S, start=start, subject=recording.subject, mounting=recording.mounting)
    localizer.reset(briefing, np.random.default_rng(seed))
    rows = {name: recording.streams[name].rows for name in names}
    last_s = max(float(one[-1, 0]) for one in rows.values())
    ends_s = np.arange(PERIOD_S, last_s + PERIOD_S, PERIOD_S)
    place_m = [np.zeros(2)]
    for now_s in ends_s.tolist():
        new = {name: one[(one[:, 0] > now_s - PERIOD_S) & (one[:, 0] <= now_s)] for name, one in rows.items()}
        place_m.append(np.array(localizer.step(Observation(now_s, new)).xy_m))
    moves_m = np.diff(np.array(place_m), axis=0)
    return Reckoned(ends_s, moves_m, np.tile(np.eye(2), (len(moves_m), 1, 1)))


def distance_figures(localizer: Localizer, recordings: Iterable[Recording]) -> dict[str, float]:
    """Means over walks of the errors of distances and of turns, see `learned.walks.walk_figures`; no covariance."""
    figures = reckoned_figures((recording, played(localizer, recording)) for recording in recordings)
    return {key: figures[key] for key in KEYS}
