"""Evaluates 200 walks of twenty milliseconds on two processes, side by side with what two perfect processes would take.

The walks do nothing but keep a processor busy, so that whatever `evaluate` adds shows: starting work, processes
talking, claims, files. "Warm" is a sweep whose processes were there already (joblib keeps them between sweeps), "cold"
one that had to start them; "stored" waits until each result has reached the disk. Bare processes are two of
joblib with the same work. Processor time is that of all processes, which hardly depends on what else the
machine does.

    python benchmarks/bench_evaluate.py [--json]
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

WALKS, WALK_S, JOBS, REPEATS = 200, 0.02, 2, 3
GOAL = 0.05

ENVIRONMENT = """
import numpy as np
from pdrbench.recording import Recording, SensorSpec
from pdrbench.task import Task
from pdrbench.trajectory import Start, Trajectory

ENVIRONMENTS = {"Still-v0": "bench_still_plugin:task"}
WALKS = tuple(f"walk-{i:03d}" for i in range(%d))
SPEC = SensorSpec("stride", ("t_s", "length_m"), np.zeros(2), np.full(2, 1e3), None, "Strides.")


def load(walk):
    t_s = np.arange(1.0, 21.0)
    return Recording(walk, None, {}, Trajectory(t_s, np.zeros((20, 2)), np.zeros(20, int), np.ones(20, bool)))


def task():
    return Task("Still-v0", "Nothing moves.", "", (SPEC,), {"stride": 1}, 1.0, "pose", {"test": WALKS}, load,
                lambda recording: Start(np.zeros(2), 0), "MIT", "generated")
"""

LOCALIZER = '''
import time
import numpy as np
from pdrbench.localizer import Estimate


class Busy:
    """Computes until its fraction of the walk's processor time is used up."""

    def reset(self, briefing, rng):
        pass

    def step(self, observation):
        ends_s = time.process_time() + %r / 21
        while time.process_time() < ends_s:
            pass
        return Estimate(np.zeros(2), 0)
'''


def install(root: Path, walks: int, modules: dict[str, str]) -> None:
    """Puts an environment, and modules by name, where packages would be installed."""
    for name, text in {"bench_still_plugin": ENVIRONMENT % walks, **modules}.items():
        (root / f"{name}.py").write_text(text)
    about = root / "bench_still_plugin-0.1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: bench-still-plugin\nVersion: 0.1\n")
    (about / "entry_points.txt").write_text("[pdrbench.environments]\nx = bench_still_plugin:ENVIRONMENTS\n")
    sys.path.insert(0, str(root))
    importlib.invalidate_caches()


def processor_s() -> float:
    """Processor time that this process and its living children have used."""
    ticks = 0
    for process in [os.getpid(), *children()]:
        ticks += sum(
            int(field) for field in Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
        )
    return ticks / os.sysconf("SC_CLK_TCK")


def children() -> list[int]:
    """Ids of the processes that this one has started and that live."""
    tasks = Path(f"/proc/{os.getpid()}/task").glob("*/children")
    return [int(process) for task in tasks for process in task.read_text().split()]


def measure(out: Callable[[], Path | None], prepare: Callable[[], None]) -> tuple[float, float, float]:
    """Wall time of a sweep, time the localizer was busy in it, processor time of all, of the best of a few."""
    from pdrbench.evaluation import evaluate

    best = (float("inf"), 1.0, 0.0)
    for _ in range(REPEATS):
        prepare()
        folder = out()
        used_s = processor_s()
        began_s = time.perf_counter()
        results = evaluate("bench_busy:Busy", "Still-v0", jobs=JOBS, out=folder)
        wall_s = time.perf_counter() - began_s
        busy_s = sum(float(result.step_s.sum()) for result in results.results)
        used_s = processor_s() - used_s
        best = min(best, (wall_s, busy_s, used_s), key=lambda pair: pair[0] / pair[1])
    return best


def perfect_s() -> float:
    """Wall time of the same busy walks in two bare processes, each with its half: what the machine allows."""
    from joblib import Parallel, delayed

    parallel = Parallel(n_jobs=JOBS, batch_size=1)
    halves = [range(0, WALKS, JOBS)] * JOBS
    parallel(delayed(keep_busy)(range(1)) for _ in halves)
    walls_s = []
    for _ in range(REPEATS):
        began_s = time.perf_counter()
        parallel(delayed(keep_busy)(half) for half in halves)
        walls_s.append(time.perf_counter() - began_s)
    return min(walls_s)


def keep_busy(walks: range) -> None:
    for _ in walks:
        for _ in range(21):
            ends_s = time.process_time() + WALK_S / 21
            while time.process_time() < ends_s:
                pass


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="machine-readable")
    as_json = parser.parse_args().json
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        install(root, WALKS, {"bench_busy": LOCALIZER % WALK_S})
        from pdrbench.bench import Timing  # entry points are read at the first import of pdrbench
        from pdrbench.evaluation.pool import discard
        from pdrbench_lab.cli.bench import print_timings

        counter = iter(range(1000))
        bare_s = perfect_s()
        cases = {
            "cold, in memory": measure(lambda: None, discard),
            "warm, in memory": measure(lambda: None, lambda: None),
            "warm, stored": measure(lambda: root / f"out{next(counter)}", lambda: None),
        }
    print(f"{WALKS} walks of {WALK_S * 1e3:g} ms, best of {REPEATS}; goal: at most {1 + GOAL:g} x", file=sys.stderr)
    rows = []
    for name, (wall_s, busy_s, used_s) in cases.items():
        ideal_s, cpu_s = busy_s / JOBS, WALKS * WALK_S
        rows += [
            Timing(name, wall_s, "s", f"half the time localizers were busy, {ideal_s:.3f} s", wall_s / ideal_s),
            Timing(name, wall_s, "s", f"two bare processes, {bare_s:.3f} s", wall_s / bare_s),
            Timing(f"{name}: processor time", used_s, "s", f"that of the walks, {cpu_s:g} s", used_s / cpu_s),
        ]
    print_timings(rows, as_json)


if __name__ == "__main__":
    main()
