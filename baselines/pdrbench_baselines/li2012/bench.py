"""`pdrbench bench phone`: step detection and warping, beside what one would use instead; then the particle filter."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from pdrbench.bench.timing import Timing, median_s
from pdrbench.geometry import FloatArray
from pdrbench.inertial.step_detection import RATE_HZ, StepDetector, StepParams, find_steps
from pdrbench.inertial.warping import warped_distance, warped_distances, z_scored
from pdrbench_baselines.li2012 import plain_steps
from pdrbench_baselines.li2012.bench_filter import li_filter

OTHER: Final = "dtaidistance"  # a library whose C code is known to be fast
WITHOUT_OTHER: Final = "not compared: dtaidistance is not installed"
PERIOD_S: Final = 0.2  # of a localizer that is asked five times a second
NUM_WAVES: Final = 400


def run(quick: bool = False, tell: Callable[[str], None] = lambda _: None) -> list[Timing]:
    """Rows of the table.

    Args:
        quick: Smaller, fewer rounds.
        tell: Receives what comes next.
    """
    rounds = 3 if quick else 9
    tell("step detection")
    rows = _detection(60.0 if quick else 600.0, rounds)
    tell("dynamic time warping")
    rows += _warping(60 if quick else NUM_WAVES, rounds)
    return rows + li_filter(quick, tell)


def walk(duration_s: float, seed: int = 1) -> FloatArray:
    """(n, 4) accelerometer rows of something like a walk: steps of two alternating shapes, and noise."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    phase = 2 * np.pi * 1.8 * (t_s + 0.1 * np.sin(2 * np.pi * 0.03 * t_s))
    up_mps2 = 9.81 + 3.0 * np.sin(phase) + 0.8 * np.sin(phase / 2) + 0.6 * np.sin(2 * phase + 1.0)
    return np.column_stack([t_s, rng.normal(0, 0.3, (len(t_s), 2)), up_mps2 + rng.normal(0, 0.3, len(t_s))])


def _detection(duration_s: float, rounds: int) -> list[Timing]:
    """A whole recording, and one that comes in pieces; the twin gets a twentieth."""
    rows = walk(duration_s)
    few = rows[: len(rows) // 20]
    pieces = np.array_split(rows, round(duration_s / PERIOD_S))

    def stream() -> None:
        detector = StepDetector(RATE_HZ)
        for piece in pieces:
            detector.update(piece)

    find_steps(few, RATE_HZ)
    taken = median_s(
        {
            "whole": lambda: lambda: find_steps(rows, RATE_HZ),
            "stream": lambda: stream,
            "twin": lambda: lambda: plain_steps.find_steps(few),
        },
        rounds,
    )
    per_s, twin_per_s = len(rows) / taken["whole"], len(few) / taken["twin"]
    return [
        Timing("steps", per_s / 1e3, "k samples/s", "NumPy twin", per_s / twin_per_s),
        Timing("steps_real_time", duration_s / taken["stream"], "s/s"),
    ]


def _warping(count: int, rounds: int) -> list[Timing]:
    """Every two of so many steps, and one step with one other; one core."""
    rng = np.random.default_rng(2)
    waves = [z_scored(np.cumsum(rng.normal(size=int(size)))) for size in rng.integers(22, 33, count)]
    pairs = count * (count - 1) / 2
    band = StepParams().band
    few = waves[: max(count // 10, 8)]
    things: dict[str, Callable[[], Callable[[], object]]] = {
        "all": lambda: lambda: warped_distances(waves, band),
        "one": lambda: lambda: [warped_distance(waves[0], wave, band) for wave in waves],
        "twin": lambda: lambda: [plain_steps.warped_distance(waves[0], wave, band) for wave in few],
    }
    other = _other()
    if other is not None:
        window = None if band is None else band + 1  # it counts the diagonal
        things["other all"] = lambda: (
            lambda: other.distance_matrix_fast(waves, window=window, parallel=False, compact=False)
        )
        things["other one"] = lambda: lambda: [other.distance_fast(waves[0], wave, window=window) for wave in waves]
    for prepare in things.values():
        prepare()()
    taken = median_s(things, rounds)
    twin = Timing("warping_twin", len(few) / taken["twin"] / 1e3, "k pairs/s")
    rows = []
    for name, per_s in (("all", pairs / taken["all"]), ("one", count / taken["one"])):
        if other is None:
            rows.append(Timing(f"warping_{name}", per_s / 1e3, "k pairs/s", WITHOUT_OTHER))
            continue
        other_per_s = (pairs if name == "all" else count) / taken[f"other {name}"]
        rows.append(Timing(f"warping_{name}", per_s / 1e3, "k pairs/s", f"{OTHER}, C, one core", per_s / other_per_s))
    return [*rows, twin]


def _other() -> Any:
    """The other library where it is installed with its compiled part, else None."""
    if importlib.util.find_spec(OTHER) is None:
        return None
    dtw = importlib.import_module(f"{OTHER}.dtw")
    return dtw if dtw.try_import_c() else None
