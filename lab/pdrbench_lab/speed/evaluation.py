"""`evaluate` on walks of twenty milliseconds in two processes, beside what two processes without it would take.

The walks do nothing but keep a processor busy, so that whatever `evaluate` adds shows: starting work, processes
talking, files. "Warm" is a sweep whose processes were there already (joblib keeps them between sweeps), "cold" one that
had to start them; "stored" waits until each result has reached the disk, "again" finds all of them there. Bare
processes are two of joblib with the same work.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from pdrbench_lab.speed.timing import Timing

WALKS: Final = {True: 20, False: 200}  # quick or not
WALK_S, STEPS, JOBS, ROUNDS = 0.02, 21, 2, 3

ENVIRONMENT: Final = """
import numpy as np
from pdrbench.recording import Recording, SensorSpec
from pdrbench.task import Task
from pdrbench.trajectory import Start, Trajectory

SPEC = SensorSpec("stride", ("t_s", "length_m"), np.zeros(2), np.full(2, 1e3), None, "Strides.")


def load(walk):
    t_s = np.arange(1.0, 21.0)
    return Recording(walk, None, {}, Trajectory(t_s, np.zeros((20, 2)), np.zeros(20, int), np.ones(20, bool)))


def task():
    walks = {"test": tuple(f"walk-{i:03d}" for i in range(%d))}
    return Task("Still-v1", "Nothing moves.", "", (SPEC,), {"stride": 1}, 1.0, "pose", walks, load,
                lambda recording: Start(np.zeros(2), 0), "MIT", "generated")
"""

LOCALIZER: Final = '''
import time
import numpy as np
from pdrbench.localizer import Estimate


class Busy:
    """Computes until its fraction of the processor time of the walk is used up."""

    def reset(self, briefing, rng):
        pass

    def step(self, observation):
        ends_s = time.process_time() + %r
        while time.process_time() < ends_s:
            pass
        return Estimate(np.zeros(2), 0)
'''


def run(quick: bool, report: Callable[[str], None]) -> list[Timing]:
    """All rows; `report` is called with what comes next."""
    from pdrbench.evaluation import evaluate
    from pdrbench.evaluation.pool import discard

    walks, rounds = WALKS[quick], 1 if quick else ROUNDS
    report("bare processes")
    bare_s = _bare_s(walks, rounds)
    with tempfile.TemporaryDirectory() as folder:
        env, localizer = Path(folder) / "still.py", Path(folder) / "busy.py"
        env.write_text(ENVIRONMENT % walks)
        localizer.write_text(LOCALIZER % (WALK_S / STEPS))

        def sweep_s(out: Path | None) -> float:
            began_s = time.perf_counter()
            evaluate(f"{localizer}:Busy", f"{env}:task", jobs=JOBS, out=out)
            return time.perf_counter() - began_s

        taken_s: dict[str, list[float]] = {name: [] for name in ("cold", "warm", "stored", "again")}
        for round_ in range(rounds):
            report(f"round {round_ + 1} of {rounds}")
            discard()
            stored_in = Path(folder) / f"out{round_}"
            for name, out in (("cold", None), ("warm", None), ("stored", stored_in), ("again", stored_in)):
                taken_s[name].append(sweep_s(out))
    rows = []
    for name, times_s in taken_s.items():
        against = "" if name == "again" else f"two bare processes, {bare_s:.3f} s"
        rows.append(Timing(name, min(times_s), "s", against, bare_s / min(times_s) if against else None))
    return rows


def _bare_s(walks: int, rounds: int) -> float:
    """Wall time of the same work in two processes, half of it each: the best that the machine allows."""
    from joblib import Parallel, delayed

    parallel = Parallel(n_jobs=JOBS, batch_size=1)
    parallel(delayed(_keep_busy)(1) for _ in range(JOBS))
    walls_s = []
    for _ in range(rounds):
        began_s = time.perf_counter()
        parallel(delayed(_keep_busy)(walks // JOBS) for _ in range(JOBS))
        walls_s.append(time.perf_counter() - began_s)
    return min(walls_s)


def _keep_busy(walks: int) -> None:
    for _ in range(walks * STEPS):
        ends_s = time.process_time() + WALK_S / STEPS
        while time.process_time() < ends_s:
            pass
