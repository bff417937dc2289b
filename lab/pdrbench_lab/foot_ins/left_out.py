"""Settings of the foot filter by leaving one set out: what is fitted, on what, and how well it does elsewhere.

A set holds all recordings of one provenance: one batch of units, one place, one group of people; gaits are strata of
it. For each set the settings are fitted on all other sets and measured on it. Beside that stands the figure of the
settings that were fitted on all of them. Whatever else differs between units (range, bias, clock, level of the
statistic) the filter estimates on line.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numba
import numpy as np
from scipy.stats import chi2

from pdrbench.datasets import is_available
from pdrbench.geometry import FloatArray
from pdrbench.inertial import FootParams, navigate
from pdrbench_lab.foot_ins.experiments import FootWalk, closure_m, nees, rmse_m, walks_of
from pdrbench_lab.reproduce.reproduction import Claim, Gate, Value, largest_over_seeds, mean_over_walks

Settings = tuple[float, ...]


FREE: Final = ("knee_fraction", "clipped_sigma_fraction")
GRIDS: Final = ((0.006, 0.012, 0.024, 0.048), (0.35, 0.7, 1.4))  # of the free settings, in the order of `FREE`
START: Final = (0.012, 1.4)  # where the search begins
SWEEPS: Final = 2
CONSISTENT: Final = (0.5, 2.0)  # ANEES of a filter whose sigma is as large as its errors
LOOP_SIGMA_M: Final = 0.01  # a loop closes to a centimetre


class Stratum(NamedTuple):
    """Recordings of one set and one gait.

    Attributes:
        name: Key of its figures.
        held_out: The set it belongs to.
        dataset: Name of the registered dataset.
        pattern: Beginning of the names of its files.
        scale: Gate of its error: m, or percent of the way for a loop.
    """

    name: str
    held_out: str
    dataset: str
    pattern: str
    scale: float


STRATA: Final = (
    Stratum("capture", "capture 2017", "foot_vicon", "2017", 0.10),
    Stratum("capture_fast", "capture 2017", "foot_vicon_2", "2017", 0.10),
    Stratum("lifts", "capture 2018", "foot_vicon_2", "2018-02-09", 0.15),
    Stratum("crawl", "capture 2018", "foot_vicon_2", "2018-02-22", 0.12),
    Stratum("walks", "strides", "foot_stride_gcp", "", 0.40),
    Stratum("walks_2", "strides", "foot_stride_gcp_2", "", 0.40),
    Stratum("loops", "loops", "foot_loops", "", 0.15),
    Stratum("short", "short", "foot_short", "", 0.15),
    Stratum("dual", "dual", "foot_dual", "", 0.08),
)
SETS: Final = tuple(dict.fromkeys(stratum.held_out for stratum in STRATA))


def params_of(settings: Settings) -> FootParams:
    """The filter with some settings, in the order of `FREE`."""
    knee, clipped = settings
    detector = replace(FootParams().detector, knee_fraction=knee)
    return FootParams(detector=detector, clipped_sigma_fraction=clipped)


def left_out(seed: int) -> dict[str, Any]:
    """Error and ANEES of every walk by stratum: `left_NAME`, `fitted_NAME`; with `_nees`, consistency.

    The error is the root mean square of the horizontal distance after SE(2) alignment in metres, of a loop the closure
    in percent of the way. Nothing is drawn: the seed does not matter.
    """
    strata, walks = available_walks()
    measure = functools.cache(lambda settings: measured(walks, params_of(settings)))
    fitted = fit(measure, strata, "")
    found: dict[str, Any] = {f"setting_{name}": value for name, value in zip(FREE, fitted, strict=True)}
    for held_out in dict.fromkeys(stratum.held_out for stratum in strata):
        for kind, settings in (("left", fit(measure, strata, held_out)), ("fitted", fitted)):
            for stratum, (error, consistency) in zip(strata, measure(settings), strict=True):
                if stratum.held_out == held_out:
                    found[f"{kind}_{stratum.name}"], found[f"{kind}_{stratum.name}_nees"] = error, consistency
    groups = {
        "all_capture": [stratum.name for stratum in STRATA if stratum.held_out.startswith("capture")],
        "all_walks": [stratum.name for stratum in STRATA if stratum.held_out == "strides"],
    }
    for held_out in SETS:
        names = [f"{stratum.name}_nees" for stratum in STRATA if stratum.held_out == held_out]
        groups[f"nees_{held_out.replace(' ', '_')}"] = names
    for kind in ("left", "fitted"):
        for group, names in groups.items():
            found[f"{kind}_{group}"] = np.concatenate([found.get(f"{kind}_{name}", np.zeros(0)) for name in names])
    return found


Measure = Callable[[Settings], Sequence[tuple[FloatArray, FloatArray]]]


def fit(measure: Measure, strata: Sequence[Stratum], held_out: str) -> Settings:
    """The best settings on all sets but one: coordinate search, `SWEEPS` times.

    Args:
        measure: Errors and ANEES of the walks of each stratum with some settings.
        strata: See `STRATA`.
        held_out: The set that is not looked at; "" to fit on all.
    """
    best: Settings = START
    for _ in range(SWEEPS):
        for index, grid in enumerate(GRIDS):
            tried = [(*best[:index], value, *best[index + 1 :]) for value in grid]
            best = min(tried, key=lambda settings: loss(measure(settings), strata, held_out))
    return best


def loss(measured: Sequence[tuple[FloatArray, FloatArray]], strata: Sequence[Stratum], held_out: str) -> float:
    """Mean over sets of the mean error of each stratum over its gate, and of how far ANEES is beyond `CONSISTENT`.

    A set of n recordings counts by the square root of n: one recording says less than 23, and 23 of one place and its
    people do not say 23 times as much. ANEES over n recordings has itself the spread of a chi-square variable with 2 n
    degrees of freedom: only what is beyond its central 95 % counts.
    """
    total, weights = [], []
    for name in {stratum.held_out for stratum in strata} - {held_out}:
        rows = [(*of, stratum.scale) for stratum, of in zip(strata, measured, strict=True) if stratum.held_out == name]
        anees = np.concatenate([consistency for _, consistency, _ in rows])
        low, high = np.multiply(CONSISTENT, chi2.ppf([0.025, 0.975], 2 * len(anees)) / (2 * len(anees)))
        beyond = max(math.log(low / anees.mean()), math.log(anees.mean() / high), 0.0)
        ratio = float(np.mean([error.mean() / scale for error, _, scale in rows]))
        total.append(ratio + 0.5 * beyond)
        weights.append(math.sqrt(len(anees)))
    return float(np.average(total, weights=weights))


def available_walks() -> tuple[list[Stratum], list[tuple[FootWalk, ...]]]:
    """The strata whose data are available, and the recordings of each."""
    strata = [stratum for stratum in STRATA if is_available(stratum.dataset)]
    every = {name: walks_of(name) for name in dict.fromkeys(stratum.dataset for stratum in strata)}
    return strata, [tuple(w for w in every[s.dataset] if w.path.name.startswith(s.pattern)) for s in strata]


def measured(walks: Sequence[Sequence[FootWalk]], params: FootParams) -> list[tuple[FloatArray, FloatArray]]:
    """Errors and ANEES of the walks of each stratum."""
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        rows = [np.array(list(pool.map(lambda walk: _scores(walk, params), group))) for group in walks]
    return [(group[:, 0], group[:, 1]) for group in rows]


def _scores(walk: FootWalk, params: FootParams) -> tuple[float, float]:
    """Error and ANEES of one recording."""
    states = navigate(*walk.rows, params)
    if len(walk.reference) > 2:
        return rmse_m(states, walk.reference), float(np.mean(nees(states, walk.reference)))
    gap_m = closure_m(states)[:2]
    known = states.position_m[np.isfinite(states.x[:, 0])][:: max(1, round(0.05 / np.median(np.diff(states.t_s))))]
    way_m = float(np.hypot(*np.diff(known[:, :2], axis=0).T).sum())
    cov = states.cov[-1, :2, :2] + LOOP_SIGMA_M**2 * np.eye(2)
    return 100 * float(np.hypot(*gap_m)) / way_m, float(gap_m @ np.linalg.solve(cov, gap_m)) / 2


def _claims() -> tuple[Claim, ...]:
    """Of each figure the left-out one, with its gate, and the one of the settings that were fitted on every set."""
    rows: list[tuple[str, str, Value, Gate | None, str]] = []
    kinds = (("left", "left out", True), ("fitted", "fitted", False))
    for key, what, gate, unit in (
        ("all_capture", "motion capture, all gaits: mean error", 0.10, "m"),
        ("lifts", "foot lifted high and lowered slowly: mean error", 0.15, "m"),
        ("crawl", "crawling: mean error", 0.12, "m"),
        ("all_walks", "walks and runs with places: mean error", 0.40, "m"),
        ("loops", "loops: mean closure", 0.15, "%"),
        ("short", "short loop: closure", math.inf, "%"),
        ("dual", "both feet, each by itself, aligned: mean error", 0.08, "m"),
    ):
        for kind, said, is_gated in kinds:
            value = mean_over_walks(f"{kind}_{key}")
            rows.append((said, what, value, Gate(high=gate) if is_gated and math.isfinite(gate) else None, unit))
        if key == "all_capture":
            for kind, said, is_gated in kinds:
                worst = Gate(high=0.5) if is_gated else None
                rows.append((said, "motion capture: worst", largest_over_seeds(f"{kind}_{key}"), worst, unit))
    for held_out in SETS:
        for kind, said, is_gated in kinds:
            key = f"{kind}_nees_{held_out.replace(' ', '_')}"
            gated = Gate(*CONSISTENT) if is_gated and held_out != "short" else None
            rows.append((said, f"{held_out}: ANEES", mean_over_walks(key), gated, ""))
    rows += [(kinds[1][1], name, largest_over_seeds(f"setting_{name}"), None, "") for name in FREE]
    return tuple(
        Claim("F7", f"{what}, {said}", "not stated", "left_out", value, gate, unit)
        for said, what, value, gate, unit in rows
    )


CLAIMS: Final = _claims()
