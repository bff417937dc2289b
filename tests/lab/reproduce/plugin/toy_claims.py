"""A reproduction whose numbers are known; environment variables name failing seeds and a call log."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pdrbench_lab.reproduce.reproduction import (
    Claim,
    Experiment,
    Gate,
    Measured,
    Reproduction,
    at_quantile,
    fraction_over_seeds,
    largest_over_seeds,
    median_over_seeds,
    pooled_percentile,
)


def _called(experiment: str, seed: int) -> None:
    if "TOY_COUNTER" in os.environ:
        with Path(os.environ["TOY_COUNTER"]).open("a") as counter:
            counter.write(f"{experiment} {seed}\n")


def steps(seed: int) -> dict[str, Any]:
    """Errors 0, 1, ..., 8 m plus the seed; every fourth seed is not found."""
    _called("steps", seed)
    began_s = time.monotonic()
    time.sleep(float(os.environ.get("TOY_SLEEP_S", "0")))
    if str(seed) in os.environ.get("TOY_RAISES", "").split(","):
        raise ZeroDivisionError(f"seed {seed} fell over")
    if str(seed) in os.environ.get("TOY_DIES", "").split(","):
        os.kill(os.getpid(), signal.SIGKILL)
    return {
        "error_m": seed + np.arange(9.0),
        "largest_m": seed + 8,
        "found": seed % 4 != 0,
        "never": math.nan,
        "endless": [math.inf, -math.inf, 0.1],
        "noise": np.random.default_rng(seed).normal(size=50),
        "span_s": (began_s, time.monotonic()),
    }


def clock(seed: int) -> dict[str, Any]:
    """When it ran."""
    _called("clock", seed)
    began_s = time.monotonic()
    time.sleep(0.02)
    return {"span_s": (began_s, time.monotonic())}


def wrong(runs: Sequence[Mapping[str, Any]]) -> Measured:
    raise LookupError("a mistake in a claim")


def figures(folder: Path, measured: Mapping[str, Sequence[Mapping[str, Any]]], quick: bool) -> list[Path]:
    """One file that states what it was drawn from."""
    _called("figures", 0)
    if "TOY_NO_FIGURES" in os.environ:
        raise OSError("no ink")
    file = folder / "errors.txt"
    file.write_text(f"{len(measured['steps'])} seeds, quick {quick}")
    return [file]


HERE = __name__
TOY = Reproduction(
    name="toy",
    paper="Toy, A.: How far is it? Journal of Closed Forms 1999",
    experiments=(
        Experiment("clock", f"{HERE}:clock", seeds=2, quick_seeds=1, alone=True),
        Experiment("steps", f"{HERE}:steps", seeds=8, quick_seeds=3),
    ),
    claims=(
        Claim(
            "T1", "error, 75 %", "10 m", "steps", median_over_seeds("error_m", at_quantile(0.75)), Gate(high=10.0), "m"
        ),
        Claim("T1", "error, pooled 50 %", "7 m", "steps", pooled_percentile("error_m", 0.5), Gate(7.0, 8.0), "m"),
        Claim("T2", "largest error", "14 m", "steps", largest_over_seeds("largest_m"), Gate(high=14.0), "m"),
        Claim("T3", "found", "most", "steps", fraction_over_seeds("found"), unit="share"),
    ),
    figures=f"{HERE}:figures",
)
MISTAKEN = Reproduction(
    name="mistaken",
    paper="Toy, A.: Errata 2000",
    experiments=(Experiment("steps", f"{HERE}:steps", seeds=1, quick_seeds=1),),
    claims=(
        Claim("M1", "a mistake", "1", "steps", wrong, Gate(low=0.0)),
        Claim("M2", "a misspelling", "2", "steps", median_over_seeds("eror_m")),
        Claim("M3", "right", "3", "steps", largest_over_seeds("largest_m"), Gate(8.0, 8.0)),
    ),
)
GONE = Reproduction("gone", "Toy, A.: Lost 2001", (Experiment("lost", f"{HERE}:nowhere"),), ())
NAMELESS = 7
