"""What distributing costs: walks that cost next to nothing, times localizers, on Dask clusters of this machine.

A walk here is the encoding of a result of twenty answers: no process of a localizer is started, so that what remains is
what `evaluate` adds to each walk and localizer: planning, sending, locks, files, notes of what is done. The first row
does the same in one process. "Again" finds everything stored. Then a worker and, later, the scheduler are killed, and
the same sweep is run once more on a new cluster: what was stored is not computed again.

    python benchmarks/bench_cluster.py [WALKS [LOCALIZERS [WORKERS...]]]
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
from bench_evaluate import install

FULL_WALKS, FULL_LOCALIZERS = 10_000, 20
MEBIBYTE = 1 << 20
LOCALIZER = "class Fake{0:02d}:\n    def reset(self, briefing, rng): pass\n    def step(self, observation): pass\n\n\n"
COMPUTE = '''
import os
import numpy as np
from pathlib import Path
from pdrbench.evaluation import store
from pdrbench.evaluation.walk_job import provenance_of
from pdrbench.result import Result
from pdrbench.trajectory import ESTIMATE_COLUMNS, Estimates

LOG = os.open(Path(__file__).parent / "computed", os.O_WRONLY | os.O_APPEND | os.O_CREAT)


def compute(job, context, note, memory):
    """A result without a walk; its name goes into a list."""
    os.write(LOG, job.name.encode() + b"\\n")
    columns = np.zeros((len(ESTIMATE_COLUMNS), 20))
    estimates = Estimates.from_columns(np.arange(20) * 1.0, columns)
    names = ("env", "split", "walk", "localizer", "seed")
    result = Result(**{name: getattr(job, name) for name in names}, estimates=estimates,
                    step_s=np.zeros(20), reset_s=0.0, provenance=provenance_of(job))
    return "complete", store.encode(result)
'''


class Cluster:
    """A scheduler and workers of one thread, each a process."""

    def __init__(self, root: Path, workers: int) -> None:
        file = root / f"{uuid.uuid4().hex}.json"
        environ = os.environ | {
            "PYTHONPATH": os.pathsep.join(sys.path),
            "DASK_DISTRIBUTED__LOGGING__DISTRIBUTED": "error",
        }
        shared = ["--scheduler-file", str(file), "--no-dashboard"]
        quiet: Any = {"env": environ, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": root}
        module = "from distributed.cli.dask_{} import main; main()"
        scheduler = [sys.executable, "-c", module.format("scheduler"), "--port", "0", *shared]
        self.scheduler = psutil.Popen(scheduler, **quiet)
        worker = [sys.executable, "-c", module.format("worker"), *shared, "--nworkers", str(workers), "--nthreads", "1"]
        while not file.is_file():
            time.sleep(0.1)
        time.sleep(0.5)
        self.workers = psutil.Popen([*worker, "--local-directory", str(root)], **quiet)
        import json

        from distributed import Client

        self.address = json.loads(file.read_text())["address"]
        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(workers)
            self.pids: list[int] = sorted(client.run(os.getpid).values())

    def used_s(self) -> tuple[float, float]:
        """Processor seconds of the scheduler, and of the workers."""
        below = [psutil.Process(pid) for pid in self.pids if psutil.pid_exists(pid)]
        return spent_s(self.scheduler), sum(spent_s(process) for process in below)

    def close(self) -> None:
        """Ends all of it."""
        every = [
            each
            for top in (self.workers, self.scheduler)
            if top.is_running()
            for each in [top, *top.children(recursive=True)]
        ]
        for process in every:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        psutil.wait_procs(every, timeout=10)


def spent_s(process: psutil.Process) -> float:
    """Processor seconds of a process."""
    times = process.cpu_times()
    return times.user + times.system


@contextlib.contextmanager
def peak_mb(process: psutil.Process) -> Iterator[list[float]]:
    """The largest memory of a process while the block runs, looked at ten times a second."""
    peak, done = [0.0], threading.Event()

    def look() -> None:
        while not done.wait(0.1) and process.is_running():
            with contextlib.suppress(psutil.NoSuchProcess):
                peak[0] = max(peak[0], process.memory_info().rss / MEBIBYTE)

    thread = threading.Thread(target=look)
    thread.start()
    try:
        yield peak
    finally:
        done.set()
        thread.join()


def sweep(jobs: list[Any], folder: Path, workers: int) -> None:
    """As `evaluate` runs jobs, with another computation; 0 workers: in this process."""
    from bench_compute import compute

    from pdrbench.evaluation.jobs import JobContext
    from pdrbench.evaluation.scheduler import run_all

    owner = os.getpid() if workers else 0
    context = JobContext(folder=folder, run=uuid.uuid4().hex, owner=owner, compute=compute)
    assert len(run_all(jobs, context, max(workers, 1), is_warm=True, progress=False, what="")) == len(jobs)


def measure(name: str, jobs: list[Any], folder: Path, cluster: Cluster | None) -> None:
    """Prints a row."""
    from pdrbench.evaluation.cluster import on_cluster

    folder.mkdir(exist_ok=True)
    here = psutil.Process()
    before, there = spent_s(here), cluster.used_s() if cluster else (0.0, 0.0)
    began_s = time.perf_counter()
    with peak_mb(cluster.scheduler if cluster else here) as peak, on_cluster(cluster.address if cluster else None):
        sweep(jobs, folder, len(cluster.pids) if cluster else 0)
    wall_s, own_s = time.perf_counter() - began_s, spent_s(here) - before
    scheduler_s, workers_s = (b - a for a, b in zip(there, cluster.used_s() if cluster else (0.0, 0.0), strict=True))
    each = [1e3 * seconds / len(jobs) for seconds in (wall_s, own_s, scheduler_s, workers_s)]
    full = 1e-3 * (each[1] + each[2]) * FULL_WALKS * FULL_LOCALIZERS
    print(f"{name:>22} " + " ".join(f"{one:9.3f}" for one in each) + f" {peak[0]:9.0f} MB {full:8.0f} s", flush=True)


def killed(jobs: list[Any], root: Path) -> None:
    """Kills a worker after a third of the results and the scheduler after two thirds, then runs the rest."""
    from pdrbench.errors import PdrbenchError
    from pdrbench.evaluation.cluster import on_cluster

    folder, log = root / "killed", root / "computed"
    folder.mkdir()
    log.write_bytes(b"")
    cluster = Cluster(root, 2)

    def after(part: float, act: Callable[[], None]) -> None:
        while log.read_bytes().count(b"\n") < part * len(jobs):
            time.sleep(0.01)
        act()

    deeds = (lambda: os.kill(cluster.pids[0], signal.SIGKILL), cluster.scheduler.kill)
    threads = [threading.Thread(target=after, args=pair) for pair in zip((1 / 3, 2 / 3), deeds, strict=True)]
    for thread in threads:
        thread.start()
    began_s = time.perf_counter()
    try:
        with on_cluster(cluster.address):
            sweep(jobs, folder, 2)
        print("the sweep outlived its scheduler")
    except PdrbenchError as error:
        print(f"the scheduler died: after {time.perf_counter() - began_s:.1f} s: {error}")
    cluster.close()
    stored = sum(path.name.endswith(".result") for path in folder.iterdir())
    cluster = Cluster(root, 2)
    with on_cluster(cluster.address):
        sweep(jobs, folder, 2)
    cluster.close()
    computed = log.read_text().splitlines()
    print(
        f"a worker and the scheduler killed: {stored} of {len(jobs)} results stored, run again: all there, "
        f"{len(computed) - len(set(computed))} computed twice"
    )


def main() -> None:
    walks, localizers, *workers = map(int, sys.argv[1:] or ("500", "20"))
    with tempfile.TemporaryDirectory() as place:
        root = Path(place)
        fakes = "".join(LOCALIZER.format(k) for k in range(localizers))
        install(root, walks, {"bench_many": fakes, "bench_compute": COMPUTE})
        from pdrbench.evaluation.walk_job import plan_walks
        from pdrbench.isolation.budget import Budget

        began_s = time.process_time()
        specs = {"Still-v0": [f"bench_many:Fake{k:02d}" for k in range(localizers)]}
        jobs: list[Any] = [
            *plan_walks(specs, split=None, seeds=[0], walks=None, parameters={}, budget=Budget(), isolation="auto")
        ]
        planned_ms = 1e3 * (time.process_time() - began_s) / len(jobs)
        print(f"{walks} walks of {localizers} localizers; ms a walk and localizer; planning takes {planned_ms:.3f}")
        heads = f"{'wall':>9} {'here':>9} {'scheduler':>9} {'workers':>9}"
        print(f"{'':>22} {heads} {'peak of it':>12} {f'of {FULL_WALKS * FULL_LOCALIZERS}':>10}")
        measure("one process", jobs, root / "one", None)
        for count in workers or (2, 4):
            cluster = Cluster(root, count)
            measure(f"{count} workers", jobs, root / f"on-{count}", cluster)
            measure(f"{count} workers again", jobs, root / f"on-{count}", cluster)
            cluster.close()
        killed(jobs, root)


if __name__ == "__main__":
    main()
