"""What Köping et al. 2012 claim, beside what `experiments` measures (claims K2, K4 to K12)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from pdrbench.evaluation.reproduction import (
    Claim,
    Experiment,
    Gate,
    Measured,
    Numbers,
    Reproduction,
    Value,
    largest_over_seeds,
    mean_over_seeds,
    median_over_seeds,
)
from pdrbench_baselines.koeping2012.experiments import COUNTS, ENOUGH

WALKS: Final = 20  # of the test split
CHANCE: Final = Gate(0.8, 1.25)  # chi-square per degree of freedom, median over seeds, where only chance is at work


def _measure(name: str, seeds: int = WALKS, quick_seeds: int = 1, *, alone: bool = False) -> Experiment:
    return Experiment(name, f"pdrbench_baselines.koeping2012.experiments:{name}", seeds, quick_seeds, alone)


def _shown(id_: str, what: str, paper: str, experiment: str, value: Value, unit: str = "") -> Claim:
    return Claim(id_, what, paper, experiment, value, None, unit)


def _of_means(above: str, below: str) -> Value:
    """Ratio of two means over seeds, without an interval."""

    def value(runs: Sequence[Numbers]) -> Measured:
        sums = [sum(float(run[key]) for run in runs) for key in (above, below)]
        return Measured(sums[0] / sums[1])

    return value


def _with_particles(count: int) -> Any:
    """The error with that many particles, of the errors of Fig. 2."""
    return lambda errors_m: float(errors_m[COUNTS.index(count)])


_TABLE: Final = (
    Claim(
        *("K2", "particles at the start against even over the floor, chi-square per cell", "uniform: 1", "table"),
        *(median_over_seeds("start_spread"), CHANCE),
    ),
    Claim(
        *("K4", "movements drawn against the table, chi-square per entry", "random entry: 1", "table"),
        *(median_over_seeds("move_spread"), CHANCE),
    ),
    Claim(
        *("K4", "movements that are not in the table", "all possible", "table"),
        *(largest_over_seeds("moved_elsewhere"), Gate(high=0)),
    ),
    Claim(
        *("K4", "least probability in the table", "low ones removed", "table"),
        *(median_over_seeds("least_probability"), Gate(low=1e-4)),
    ),
    Claim(
        *("K4", "longest way in an empty hall over the straight line", "not stated", "table"),
        *(largest_over_seeds("longest_detour"), Gate(high=1.0275)),
    ),
    _shown("K4", "the floor: cells of 0.5 m", "not stated", "table", median_over_seeds("num_cells")),
    _shown("K4", "the floor: movements", "not stated", "table", median_over_seeds("num_entries")),
    _shown("K4", "the floor: table", "not stated", "table", median_over_seeds("megabytes"), "MB"),
    _shown("K4", "the floor: time to make it", "offline", "speed", median_over_seeds("replica_s"), "s"),
    _shown("K4", "8725 m² on three levels: cells", "not stated", "speed", median_over_seeds("lab_cells")),
    _shown("K4", "8725 m² on three levels: movements", "not stated", "speed", median_over_seeds("lab_entries")),
    Claim(
        *("K4", "8725 m² on three levels: table", "fits", "speed"),
        *(median_over_seeds("lab_megabytes"), Gate(high=100), "MB"),
    ),
    _shown("K4", "8725 m² on three levels: time to make it", "offline", "speed", median_over_seeds("lab_s"), "s"),
    Claim(
        *("K7", "floor area", "16 m x 30 m", "table"),
        *(median_over_seeds("area_m2"), Gate.around(480, 0.001), "m²"),
    ),
    Claim(
        *("K4", "floor area in cells", "all of it", "table"),
        *(median_over_seeds("cells_m2"), Gate.around(480, 0.001), "m²"),
    ),
)
_SENSOR: Final = (
    *(
        Claim(
            *("K5", f"{reading}: variance after 120 s over the model's", "constantly growing", "table"),
            *(mean_over_seeds(f"{reading}_variance"), Gate.around(1, 0.05)),
        )
        for reading in ("iid", "drift")
    ),
    *(
        _shown(
            *("K5", f"{reading}: correlation of errors 10 s apart", paper, "table"),
            *(mean_over_seeds(f"{reading}_correlation"),),
        )
        for reading, paper in (("iid", "0 in this reading"), ("drift", "near 1 in this reading"))
    ),
    Claim(
        *("K6", "particles drawn against their weights, chi-square per particle", "∝ weight: 1", "table"),
        *(median_over_seeds("draw_spread"), CHANCE),
    ),
)
_PARTICLES: Final = tuple(
    claim
    for reading in ("iid", "drift")
    for claim in (
        Claim(
            *("K8", f"{reading}: error with 2000 particles over 50 000", "not outperformed", "accuracy"),
            *(median_over_seeds(f"{reading}_ratio"), Gate(high=1.05)),
        ),
        *(
            _shown(
                *("K8", f"{reading}: mean error, {count} particles", "figure only", "accuracy"),
                *(mean_over_seeds(f"{reading}_error_m", _with_particles(count)), "m"),
            )
            for count in (COUNTS[0], ENOUGH, COUNTS[-1])
        ),
        _shown(
            *("K8", f"{reading}: mean error of the sensor alone", "not enough over time", "accuracy"),
            *(mean_over_seeds(f"{reading}_sensor_m"), "m"),
        ),
        _shown(
            *("K12", f"{reading}: mean error of the heaviest cell, 2000 particles", "not stated", "accuracy"),
            *(mean_over_seeds(f"{reading}_map_m"), "m"),
        ),
    )
)
_SPEED: Final = (
    Claim(
        *("K9", "an update with 100 000 particles, one thread", "within 1 s", "speed"),
        *(median_over_seeds("at_100000_s"), Gate(high=1.0), "s"),
    ),
    Claim(
        *("K9", "time grows with particles, 10 000 to 1 M, to the power", "linear", "speed"),
        *(median_over_seeds("exponent_of_many"), Gate(0.85, 1.15)),
    ),
    _shown(
        *("K9", "the same from 1000 on, where a fixed cost per update counts", "linear", "speed"),
        *(median_over_seeds("exponent"),),
    ),
)
_LINEAR: Final = (
    Claim(
        *("K10", "14 m on a cart, as measured: error at the end", "unusable", "linear"),
        *(median_over_seeds("raw_m"), Gate(low=5.0), "m"),
    ),
    Claim(
        *("K10", "the same, constant bias subtracted", "usable", "linear"),
        *(median_over_seeds("corrected_m"), Gate(high=1.0), "m"),
    ),
    Claim(
        *("K10", "the same, with zero velocities at rest", "not in the paper", "linear"),
        *(median_over_seeds("updated_m"), Gate(high=0.3), "m"),
    ),
    _shown(
        *("K10", "in the hand, constant bias subtracted", "not in the paper", "linear"),
        *(median_over_seeds("in_hand_m"), "m"),
    ),
    _shown(
        *("K10", "on the shoe, zero-velocity updates", "not in the paper", "linear"),
        *(median_over_seeds("on_foot_m"), "m"),
    ),
)
_BEYOND: Final = (
    Claim(
        *("K11", "drift, after 120 s: error with heading and speed over the literal filter's", "to be added", "beyond"),
        *(median_over_seeds("drift_ratio"), Gate(high=0.5)),
    ),
    _shown(
        *("K11", "drift, after 120 s: ratio of the means over walks", "to be added", "beyond"),
        *(_of_means("drift_heading_m", "drift_literal_m"),),
    ),
    *(
        _shown(
            *("K11", f"{reading}, after 120 s: mean error, {what}", "not stated", "beyond"),
            *(mean_over_seeds(f"{reading}_{key}_m"), "m"),
        )
        for reading in ("drift", "iid")
        for key, what in (("sensor", "sensor alone"), ("literal", "literal"), ("heading", "heading and speed"))
    ),
    *(
        _shown(
            *("K11", f"{reading}: clouds drawn again in two minutes, heading and speed", "not stated", "beyond"),
            *(mean_over_seeds(f"{reading}_deaths"),),
        )
        for reading in ("drift", "iid")
    ),
)

REPRODUCTION: Final = Reproduction(
    name="koeping2012",
    paper="L. Köping, T. Mühsam, C. Ofenberg, B. Czech, M. Bernard, J. Schmer, F. Deinzer: Indoor navigation using "
    "particle filter and sensor fusion. Annual of Navigation 19/2012, part 2",
    experiments=(
        _measure("accuracy"),
        _measure("beyond"),
        _measure("table"),
        _measure("linear"),
        _measure("speed", seeds=3, alone=True),
    ),
    claims=(*_TABLE, *_SENSOR, *_PARTICLES, *_SPEED, *_LINEAR, *_BEYOND),
    figures="pdrbench_baselines.koeping2012.figures:draw",
)
