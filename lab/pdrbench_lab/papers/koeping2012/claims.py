"""What Köping et al. 2012 claim, beside what `experiments` measures (claims K2, K4 to K12)."""

from __future__ import annotations

from operator import itemgetter
from typing import Final

from pdrbench_lab.papers.koeping2012.experiments import COUNTS, ENOUGH
from pdrbench_lab.reproduce.reproduction import Claim, Experiment, Gate, Reproduction, ratio_over_seeds
from pdrbench_lab.reproduce.reproduction import largest_over_seeds as largest
from pdrbench_lab.reproduce.reproduction import mean_over_seeds as mean
from pdrbench_lab.reproduce.reproduction import median_over_seeds as median

WALKS: Final = 20  # of the test split
CHANCE: Final = Gate(0.8, 1.25)  # chi-square per degree of freedom, median over seeds, where only chance is at work


def _measure(name: str, seeds: int = WALKS, *, alone: bool = False) -> Experiment:
    return Experiment(name, f"pdrbench_lab.papers.koeping2012.experiments:{name}", seeds, quick_seeds=1, alone=alone)


_accuracy, _beyond, _table, _linear = (_measure(name) for name in ("accuracy", "beyond", "table", "linear"))
_speed = _measure("speed", seeds=3, alone=True)


_TABLE: Final = (
    _table.claim(
        *("K2", "particles at the start against even over the floor, chi-square per cell", "uniform: 1"),
        *(median("start_spread"), CHANCE),
    ),
    _table.claim(
        *("K4", "movements drawn against the table, chi-square per entry", "random entry: 1"),
        *(median("move_spread"), CHANCE),
    ),
    _table.claim("K4", "movements that are not in the table", "all possible", largest("moved_elsewhere"), Gate(high=0)),
    _table.claim(
        "K4", "least probability in the table", "low ones removed", median("least_probability"), Gate(low=1e-4)
    ),
    _table.claim(
        *("K4", "longest way in an empty hall over the straight line", "not stated"),
        *(largest("longest_detour"), Gate(high=1.0275)),
    ),
    _table.claim("K4", "the floor: cells of 0.5 m", "not stated", median("num_cells")),
    _table.claim("K4", "the floor: movements", "not stated", median("num_entries")),
    _table.claim("K4", "the floor: table", "not stated", median("megabytes"), None, "MB"),
    _speed.claim("K4", "the floor: time to make it", "offline", median("replica_s"), None, "s"),
    _speed.claim("K4", "8725 m² on three levels: cells", "not stated", median("lab_cells")),
    _speed.claim("K4", "8725 m² on three levels: movements", "not stated", median("lab_entries")),
    _speed.claim("K4", "8725 m² on three levels: table", "fits", median("lab_megabytes"), Gate(high=100), "MB"),
    _speed.claim("K4", "8725 m² on three levels: time to make it", "offline", median("lab_s"), None, "s"),
    _table.claim("K7", "floor area", "16 m x 30 m", median("area_m2"), Gate.around(480, 0.001), "m²"),
    _table.claim("K4", "floor area in cells", "all of it", median("cells_m2"), Gate.around(480, 0.001), "m²"),
)
_SENSOR: Final = (
    *(
        _table.claim(
            *("K5", f"{reading}: variance after 120 s over the model's", "constantly growing"),
            *(mean(f"{reading}_variance"), Gate.around(1, 0.05)),
        )
        for reading in ("iid", "drift")
    ),
    *(
        _table.claim("K5", f"{reading}: correlation of errors 10 s apart", paper, mean(f"{reading}_correlation"))
        for reading, paper in (("iid", "0 in this reading"), ("drift", "near 1 in this reading"))
    ),
    _table.claim(
        *("K6", "particles drawn against their weights, chi-square per particle", "∝ weight: 1"),
        *(median("draw_spread"), CHANCE),
    ),
)


def _particles(reading: str) -> tuple[Claim, ...]:
    """K8 and K12, of one reading of the sensor."""
    return (
        _accuracy.claim(
            *("K8", f"{reading}: error with 2000 particles over 50 000", "not outperformed"),
            *(median(f"{reading}_ratio"), Gate(high=1.05)),
        ),
        *(
            _accuracy.claim(
                *("K8", f"{reading}: mean error, {count} particles", "figure only"),
                *(mean(f"{reading}_error_m", itemgetter(COUNTS.index(count))), None, "m"),
            )
            for count in (COUNTS[0], ENOUGH, COUNTS[-1])
        ),
        _accuracy.claim(
            *("K8", f"{reading}: mean error of the sensor alone", "not enough over time"),
            *(mean(f"{reading}_sensor_m"), None, "m"),
        ),
        _accuracy.claim(
            *("K12", f"{reading}: mean error of the heaviest cell, 2000 particles", "not stated"),
            *(mean(f"{reading}_map_m"), None, "m"),
        ),
    )


_SPEED: Final = (
    _speed.claim(
        *("K9", "an update with 100 000 particles, one thread", "within 1 s"),
        *(median("at_100000_s"), Gate(high=1.0), "s"),
    ),
    _speed.claim(
        *("K9", "time grows with particles, 10 000 to 1 M, to the power", "linear"),
        *(median("exponent_of_many"), Gate(0.85, 1.15)),
    ),
    _speed.claim("K9", "the same from 1000 on, where a fixed cost per update counts", "linear", median("exponent")),
)
_LINEAR: Final = (
    _linear.claim(
        "K10", "14 m on a cart, as measured: error at the end", "unusable", median("raw_m"), Gate(low=5.0), "m"
    ),
    _linear.claim("K10", "the same, constant bias subtracted", "usable", median("corrected_m"), Gate(high=1.0), "m"),
    _linear.claim(
        "K10", "the same, with zero velocities at rest", "not in the paper", median("updated_m"), Gate(high=0.3), "m"
    ),
    _linear.claim("K10", "in the hand, constant bias subtracted", "not in the paper", median("in_hand_m"), None, "m"),
    _linear.claim("K10", "on the shoe, zero-velocity updates", "not in the paper", median("on_foot_m"), None, "m"),
)
_BEYOND: Final = (
    _beyond.claim(
        *("K11", "drift, after 120 s: error with heading and speed over the literal filter's", "to be added"),
        *(median("drift_ratio"), Gate(high=0.5)),
    ),
    _beyond.claim(
        *("K11", "drift, after 120 s: ratio of the means over walks", "to be added"),
        ratio_over_seeds("drift_heading_m", "drift_literal_m"),
    ),
    *(
        _beyond.claim(
            *("K11", f"{reading}, after 120 s: mean error, {what}", "not stated"),
            *(mean(f"{reading}_{key}_m"), None, "m"),
        )
        for reading in ("drift", "iid")
        for key, what in (("sensor", "sensor alone"), ("literal", "literal"), ("heading", "heading and speed"))
    ),
    *(
        _beyond.claim(
            *("K11", f"{reading}: clouds drawn again in two minutes, heading and speed", "not stated"),
            mean(f"{reading}_deaths"),
        )
        for reading in ("drift", "iid")
    ),
)

REPRODUCTION: Final = Reproduction(
    name="koeping2012",
    paper="L. Köping, T. Mühsam, C. Ofenberg, B. Czech, M. Bernard, J. Schmer, F. Deinzer: Indoor navigation using "
    "particle filter and sensor fusion. Annual of Navigation 19/2012, part 2",
    experiments=(_accuracy, _beyond, _table, _linear, _speed),
    claims=(*_TABLE, *_SENSOR, *_particles("iid"), *_particles("drift"), *_SPEED, *_LINEAR, *_BEYOND),
    figures="pdrbench_lab.papers.koeping2012.figures:draw",
)
