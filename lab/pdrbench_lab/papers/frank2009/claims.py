"""What Frank et al. 2009 claim, beside what `experiments` measures (claims F1 to F4, F8, F10, F11, F14)."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench_lab.papers.frank2009.radio import UJI, UJI_CLAIMS
from pdrbench_lab.reproduce.number_text import SHARE
from pdrbench_lab.reproduce.reproduction import Claim, Experiment, Gate, Reproduction
from pdrbench_lab.reproduce.reproduction import largest_over_seeds as largest
from pdrbench_lab.reproduce.reproduction import mean_over_seeds as mean
from pdrbench_lab.reproduce.reproduction import median_over_seeds as median

WALKS: Final = 20  # of the test split
WLAN: Final = Gate.around(3.1777, 0.1)  # F1
FUSED: Final = Gate.around(1.6468, 0.1)  # F1


def _measure(name: str, seeds: int = WALKS, quick_seeds: int = 1) -> Experiment:
    return Experiment(name, f"pdrbench_lab.papers.frank2009.experiments:{name}", seeds, quick_seeds)


_hallway, _ablation = _measure("hallway", quick_seeds=2), _measure("ablation", seeds=8)
_pace = _measure("pace")
_misalignment, _no_map, _jacobian = _measure("misalignment"), _measure("no_map", seeds=4), _measure("jacobian", seeds=1)


def _mean_error(what: str, paper: str, key: str, gate: Gate | None = None) -> Claim:
    return _hallway.claim("F1", f"{what}: mean error", paper, median(key, np.mean), gate, "m")


_ERRORS: Final = (
    _mean_error("WLAN, 49 passages", "3.1777 m", "wlan_49_error_m", WLAN),
    _mean_error("fused, 49 passages", "1.6468 m", "fused_49_error_m", FUSED),
    _hallway.claim("F1", "fused over WLAN, 49 passages", "0.518", median("fused_49_ratio"), Gate(high=0.55)),
    _mean_error("WLAN, all 68 passages", "3.1777 m", "wlan_error_m", WLAN),
    _mean_error("fused, all 68 passages", "1.6468 m", "fused_error_m", FUSED),
    _hallway.claim("F1", "fused over WLAN, all 68 passages", "0.518", median("fused_ratio"), Gate(high=0.55)),
    _mean_error("fused, after the first lap", "not stated", "fused_later_error_m"),
    _mean_error("fused and robust", "beyond", "robust_error_m"),
    _hallway.claim("F1", "fused and robust over WLAN", "beyond", median("robust_ratio")),
)
_DISTRIBUTION: Final = (
    _hallway.claim("F2", "WLAN: errors below 0.5 m", "> 20 %", median("wlan_beside", np.mean), Gate(low=0.2), SHARE),
    _hallway.claim("F2", "WLAN: errors above 4 m", "20 %", median("wlan_far", np.mean), Gate(0.15, 0.25), SHARE),
    _hallway.claim("F2", "fused: errors above 4 m", "< 5 %", median("fused_far", np.mean), Gate(high=0.05), SHARE),
    _hallway.claim("F2", "fused: median error", "around 1 m", median("fused_error_m", np.median), None, "m"),
    _hallway.claim("F2", "fused and robust: errors above 4 m", "beyond", median("robust_far", np.mean), None, SHARE),
)
_PACE: Final = (
    _pace.claim(
        "F1", "pace of these walks, chosen for the interval of F6", "not stated", mean("slow_speed_mps"), None, "m/s"
    ),
    _pace.claim(
        "F1", "the same walks with SHOE: mean error", "beyond", median("slow_shoe_error_m", np.mean), None, "m"
    ),
    _pace.claim("F1", "pace measured on people", "not stated", mean("speed_mps"), None, "m/s"),
    *(
        _pace.claim("F1", f"at that pace, {what}: mean error", paper, median(f"{name}_error_m", np.mean), None, "m")
        for name, what, paper in (
            ("wlan", "WLAN", "3.1777 m"),
            ("interval", "fused, interval of F6", "1.6468 m"),
            ("shoe", "fused, SHOE", "1.6468 m"),
        )
    ),
    *(
        _pace.claim("F1", f"at that pace, fused over WLAN, {what}", "0.518", median(f"{name}_ratio"))
        for name, what in (("interval", "interval of F6"), ("shoe", "SHOE"))
    ),
)
_RADIO: Final = (
    _hallway.claim("F3", "access points in a scan", "not stated", median("heard_in_a_scan")),
    _hallway.claim("F3", "fewest access points at a calibration point", "≥ 3", median("heard_at_a_point", np.min)),
    *(
        _ablation.claim("F3", f"{setting}: {name}, mean error", "not stated", median(f"{key}_{under}_m"), None, "m")
        for setting, under in (
            ("calibration points every 5 m", "5m"),
            ("6 access points", "6_access_points"),
            ("3 access points", "3_access_points"),
        )
        for name, key in (("WLAN", "wlan"), ("fused", "fused"))
    ),
)
_ALGORITHM: Final = (
    _misalignment.claim(
        *("F8", "sensor turned by 40°: misalignment off by", "recovered"), *(largest("off_by_deg"), Gate(high=1.0), "°")
    ),
    _misalignment.claim(
        *("F8", "sensor turned by 40°: steps off by", "the same steps"),
        *(largest("step_off_m", np.max), Gate(high=0.02), "m"),
    ),
    _misalignment.claim("F8", "steps to the side, mean", "0", median("lateral_m", np.mean), None, "m"),
    _hallway.claim("F10", "normalised innovation squared, mean", "2 if consistent", mean("nis")),
    _jacobian.claim("F11", "Jacobian off finite differences", "eq. 15-17", largest("off_by"), Gate(high=1e-6)),
    _hallway.claim("F14", "maps given", "0", largest("maps_given"), Gate(high=0)),
    _no_map.claim("F14", "answers that change when a map is given", "0", largest("differ"), Gate(high=0)),
)

REPRODUCTION: Final = Reproduction(
    name="frank2009",
    paper=(
        "K. Frank, B. Krach, N. Catterall, P. Robertson: Development and evaluation of a combined WLAN & inertial "
        "indoor pedestrian positioning system. 2009"
    ),
    experiments=(_hallway, _pace, _ablation, _misalignment, _no_map, _jacobian, UJI),
    claims=(*_ERRORS, *_PACE, *_DISTRIBUTION, *_RADIO, *_ALGORITHM, *UJI_CLAIMS),
    figures="pdrbench_lab.papers.frank2009.figures:draw",
)
