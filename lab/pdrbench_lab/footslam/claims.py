"""What is claimed of FootSLAM, beside what rounds of one loop show."""

from __future__ import annotations

from functools import partial
from typing import Final

from pdrbench_lab.foot_ins.experiments import LOOPS
from pdrbench_lab.reproduce import reproduction
from pdrbench_lab.reproduce.reproduction import Claim, Experiment, Gate, Reproduction, mean_over_seeds

# All loops are of one unit, so that there is no interval over walks.
mean_over_walks = partial(reproduction.mean_over_walks, units="unit")
_ROUNDS: Final = Experiment("rounds", "pdrbench_lab.footslam.experiments:rounds", 3, 1, envs=(LOOPS,))
_REGIMES: Final = (("real", "as recorded"), ("drift", "with a drift of 0.29° a stride added"))
_WHO: Final = (
    ("strides", "strides alone"),
    ("nomap", "the filter without a map"),
    ("map", "footslam"),
    ("map_half", "footslam with hexagons of 0.5 m"),
)
_WHEN: Final = (
    ("end1", "end of round 1"),
    ("middle2", "middle of round 2"),
    ("end2", "end of round 2"),
    ("end4", "end of round 4"),
    *((f"mean{number}", f"mean over round {number}") for number in (1, 2, 3, 4)),
)
_BOUNDED: Final = tuple(
    _ROUNDS.claim(
        "R1",
        f"{said}: mean over round 4 of {name}, over that of strides alone",
        "lower: the error does not grow",
        mean_over_seeds(f"{who}_{regime}_ratio"),
        Gate(high=0.999),
    )
    for regime, said in _REGIMES
    for who, name in _WHO[2:]
)
_SHOWN: Final = tuple(
    Claim(
        *("R2", f"{said}, {name}: {when}", "not stated", "rounds"),
        *(mean_over_walks(f"{who}_{regime}_{moment}"), None, "m"),
    )
    for regime, said in _REGIMES
    for who, name in _WHO
    for moment, when in _WHEN
)
REPRODUCTION: Final = Reproduction(
    name="footslam",
    paper="P. Robertson, M. Angermann, B. Krach: Simultaneous localization and mapping for pedestrians using only "
    "foot-mounted inertial sensors. UbiComp 2009",
    experiments=(_ROUNDS,),
    claims=(*_BOUNDED, *_SHOWN),
)
