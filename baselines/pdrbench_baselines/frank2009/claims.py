"""What Frank et al. 2009 claim, beside what `experiments` measures (claims F1 to F4, F8, F10, F11, F14)."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.evaluation.number_text import SHARE
from pdrbench.evaluation.reproduction import (
    Claim,
    Experiment,
    Gate,
    Reproduction,
    claims_of,
    largest_over_seeds,
    mean_over_seeds,
    median_over_seeds,
)
from pdrbench_baselines.frank2009.radio import UJI, UJI_CLAIMS

WALKS: Final = 20  # of the test split
WLAN_M: Final = 3.1777  # F1
FUSED_M: Final = 1.6468  # F1


def _measure(name: str, seeds: int = WALKS, quick_seeds: int = 2) -> Experiment:
    return Experiment(name, f"pdrbench_baselines.frank2009.experiments:{name}", seeds, quick_seeds)


def _mean_error(what: str, paper: str, key: str, gate: Gate | None = None) -> Claim:
    return Claim("F1", what, paper, "hallway", median_over_seeds(key, np.mean), gate, "m")


# Claims of one experiment: what, the paper's statement, and the value.
_hallway_f1 = claims_of("F1", "hallway")
_hallway_share = claims_of("F2", "hallway", SHARE)
_hallway_f3 = claims_of("F3", "hallway")
_misalignment_m = claims_of("F8", "misalignment", "m")

_ERRORS: Final = (
    _mean_error("WLAN, 49 passages: mean error", "3.1777 m", "wlan_49_error_m", Gate.around(WLAN_M, 0.1)),
    _mean_error("fused, 49 passages: mean error", "1.6468 m", "fused_49_error_m", Gate.around(FUSED_M, 0.1)),
    _hallway_f1("fused over WLAN, 49 passages", "0.518", median_over_seeds("fused_49_ratio"), Gate(high=0.55)),
    _mean_error("WLAN, all 68 passages: mean error", "3.1777 m", "wlan_error_m", Gate.around(WLAN_M, 0.1)),
    _mean_error("fused, all 68 passages: mean error", "1.6468 m", "fused_error_m", Gate.around(FUSED_M, 0.1)),
    _hallway_f1("fused over WLAN, all 68 passages", "0.518", median_over_seeds("fused_ratio"), Gate(high=0.55)),
    _mean_error("fused, after the first lap: mean error", "not stated", "fused_later_error_m"),
    _mean_error("fused and robust: mean error", "beyond", "robust_error_m"),
    _hallway_f1("fused and robust over WLAN", "beyond", median_over_seeds("robust_ratio")),
)
_DISTRIBUTION: Final = (
    _hallway_share("WLAN: errors below 0.5 m", "> 20 %", median_over_seeds("wlan_beside", np.mean), Gate(low=0.2)),
    _hallway_share("WLAN: errors above 4 m", "20 %", median_over_seeds("wlan_far", np.mean), Gate(0.15, 0.25)),
    _hallway_share("fused: errors above 4 m", "< 5 %", median_over_seeds("fused_far", np.mean), Gate(high=0.05)),
    Claim(
        *("F2", "fused: median error", "around 1 m", "hallway"),
        *(median_over_seeds("fused_error_m", np.median), None, "m"),
    ),
    _hallway_share("fused and robust: errors above 4 m", "beyond", median_over_seeds("robust_far", np.mean)),
)
_RADIO: Final = (
    _hallway_f3("access points in a scan", "not stated", median_over_seeds("heard_in_a_scan")),
    _hallway_f3("fewest access points at a calibration point", "≥ 3", median_over_seeds("heard_at_a_point", np.min)),
    *(
        Claim(
            "F3",
            f"{setting}: {name}, mean error",
            "not stated",
            "ablation",
            median_over_seeds(f"{key}_{under}_m"),
            None,
            "m",
        )
        for setting, under in (
            ("calibration points every 5 m", "5m"),
            ("6 access points", "6_access_points"),
            ("3 access points", "3_access_points"),
        )
        for name, key in (("WLAN", "wlan"), ("fused", "fused"))
    ),
)
_ALGORITHM: Final = (
    Claim(
        *("F8", "sensor turned by 40°: misalignment off by", "recovered", "misalignment"),
        *(largest_over_seeds("off_by_deg"), Gate(high=1.0), "°"),
    ),
    _misalignment_m(
        "sensor turned by 40°: steps off by",
        "the same steps",
        largest_over_seeds("step_off_m", np.max),
        Gate(high=0.02),
    ),
    _misalignment_m("steps to the side, mean", "0", median_over_seeds("lateral_m", np.mean)),
    Claim("F10", "normalised innovation squared, mean", "2 if consistent", "hallway", mean_over_seeds("nis")),
    Claim(
        *("F11", "Jacobian off finite differences", "eq. 15-17", "jacobian"),
        *(largest_over_seeds("off_by"), Gate(high=1e-6)),
    ),
    Claim("F14", "maps told", "0", "hallway", largest_over_seeds("maps_told"), Gate(high=0)),
    Claim("F14", "answers that change when a map is told", "0", "no_map", largest_over_seeds("differ"), Gate(high=0)),
)

REPRODUCTION: Final = Reproduction(
    name="frank2009",
    paper=(
        "K. Frank, B. Krach, N. Catterall, P. Robertson: Development and evaluation of a combined WLAN & inertial "
        "indoor pedestrian positioning system. 2009"
    ),
    experiments=(
        _measure("hallway"),
        _measure("ablation", seeds=8, quick_seeds=1),
        _measure("misalignment", quick_seeds=1),
        _measure("no_map", seeds=4, quick_seeds=1),
        _measure("jacobian", seeds=1, quick_seeds=1),
        UJI,
    ),
    claims=(*_ERRORS, *_DISTRIBUTION, *_RADIO, *_ALGORITHM, *UJI_CLAIMS),
    figures="pdrbench_baselines.frank2009.figures:draw",
)
