"""Synthetic walks with every sensor: seconds and memory, whether both grow evenly, and whether two processes help."""

from __future__ import annotations

import functools
import hashlib
import multiprocessing
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import psutil  # type: ignore[import-untyped]

from pdrbench.recording import Recording
from pdrbench_lab.speed.timing import Timing, median_s
from pdrbench_sim.buildings.office import make_office
from pdrbench_sim.record import IN_HAND, ON_FOOT, BuildingScene, Setup, make_scene, simulate_walk

RATE_HZ: Final = 100.0
MINUTES: Final = (1, 4, 16, 64)
QUICK_MINUTES: Final = (1, 2, 4)
SETUPS: Final[dict[str, Setup]] = {
    "phone": replace(IN_HAND, rate_hz=RATE_HZ),
    "foot": replace(ON_FOOT, rate_hz=RATE_HZ),
}
WARM_S: Final = 20.0  # of a walk after which nothing is left to compile
SEED: Final = 1


def run(quick: bool, tell: Callable[[str], None]) -> list[Timing]:
    """All rows; `tell` receives what comes next."""
    minutes, rounds = (QUICK_MINUTES, 1) if quick else (MINUTES, 3)
    tell("compiling")
    began = time.perf_counter()
    scene = bench_scene()
    rows = [Timing("scene", time.perf_counter() - began, "s")]
    for name in SETUPS:
        walk_once(name, WARM_S)
    tell(f"walks of {', '.join(map(str, minutes))} minutes with all sensors at {RATE_HZ:g} Hz")
    taken = median_s({f"{name}_{m}": _walking(scene, name, m) for name in SETUPS for m in minutes}, rounds)
    for name in SETUPS:
        rows += _growth(name, {m: taken[f"{name}_{m}"] for m in minutes})
    longest = minutes[-2]
    tell("memory")
    rows += [_memory(name, longest) for name in SETUPS]
    tell("two processes")
    return rows + _two_processes(60.0 * longest, rounds)


@functools.cache
def bench_scene() -> BuildingScene:
    """An office of three levels, the same in every process."""
    rng = np.random.default_rng(0)
    return make_scene(rng, make_office(rng))


def walk_once(name: str, duration_s: float, seed: int = SEED) -> str:
    """Digest of the streams of one walk of a setup."""
    return digest(simulate_walk(bench_scene(), seed, SETUPS[name], duration_s=duration_s))


def digest(recording: Recording) -> str:
    """Hex sha256 over the bytes of every stream and of the reference."""
    total = hashlib.sha256()
    for name in sorted(recording.streams):
        total.update(name.encode() + np.ascontiguousarray(recording.streams[name].rows).tobytes())
    total.update(np.ascontiguousarray(recording.reference.xy_m).tobytes())
    return total.hexdigest()


def _walking(scene: BuildingScene, name: str, minutes: int) -> Callable[[], Callable[[], object]]:
    return lambda: lambda: simulate_walk(scene, SEED, SETUPS[name], duration_s=60.0 * minutes)


def _growth(name: str, taken: dict[int, float]) -> list[Timing]:
    """A row for each length, held against the second shortest; the shortest has what a walk costs beside its length."""
    base = sorted(taken)[1]
    return [
        Timing(
            f"{name}_{minutes}_min",
            seconds,
            "s",
            f"{minutes}/{base} of the walk of {base} minutes" if minutes > base else "",
            taken[base] * minutes / base / seconds if minutes > base else None,
        )
        for minutes, seconds in taken.items()
    ]


_PEAK: Final = """
from pdrbench_lab.speed.simulate import peak_kib, walk_once
walk_once({name!r}, {duration_s})
print(peak_kib())
"""


def peak_kib() -> int:
    """The most memory that this process has had at a time.

    Linux reports it of the program alone; `getrusage` there inherits the peak of the process that started it.
    """
    status = Path("/proc/self/status")
    if status.exists():
        return int(next(line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM")))
    memory = psutil.Process().memory_info()
    if hasattr(memory, "peak_wset"):  # Windows
        return int(memory.peak_wset) // 1024
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak // 1024 if sys.platform == "darwin" else peak  # bytes there


def _memory(name: str, minutes: int) -> Timing:
    """Of a process that does nothing but this, interpreter and libraries included."""
    code = _PEAK.format(name=name, duration_s=60.0 * minutes)
    reported = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    return Timing(f"{name}_{minutes}_min_memory", int(reported) * 1024 / 1e6, "MB")


def _two_processes(duration_s: float, rounds: int) -> list[Timing]:
    """Two walks, one after the other and side by side; the bytes have to be the same."""
    seeds = (SEED, SEED + 1)
    alone = [walk_once("phone", duration_s, seed) for seed in seeds]
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn"), _warm) as pool:

        def together() -> list[str]:
            return list(pool.map(walk_once, ("phone",) * 2, (duration_s,) * 2, seeds))

        is_same = together() == alone  # and both processes are warm
        taken = median_s(
            {"one": lambda: lambda: [walk_once("phone", duration_s, seed) for seed in seeds], "two": lambda: together},
            rounds,
        )
    return [
        Timing("two_walks_two_processes", taken["two"], "s", "one process", taken["one"] / taken["two"]),
        Timing("same_bytes", float(is_same), "", "two processes, one"),
    ]


def _warm() -> None:
    walk_once("phone", WARM_S)
