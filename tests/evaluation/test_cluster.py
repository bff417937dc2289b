"""Sweeps on a real Dask cluster of two processes on this machine, one of which is killed in the middle."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any

import joblib
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.evaluation import cluster, evaluate, load_results, store
from pdrbench.evaluation.cluster import ClusterError, on_cluster

WALKS = 12
KILL_AFTER = 3  # results
# A sweep over a cluster; kills a worker once some results are stored, and records when.
SCRIPT = """
import json, os, signal, sys, threading, time
from pathlib import Path

def kill_one(client, out, record):
    while len(list(out.glob("*.result"))) < record["after"]:
        time.sleep(0.005)
    pids = sorted(client.run(os.getpid).values())
    record["stored"] = sorted(path.name for path in out.glob("*.result"))
    record["begun"] = len(Path(os.environ["CORRIDOR_LOADS"]).read_text().splitlines())
    os.kill(pids[0], signal.SIGKILL)
    record["workers"] = len(pids)

def main(order):
    from distributed import Client, LocalCluster
    from pdrbench.evaluation import evaluate
    from pdrbench.evaluation.cluster import on_cluster

    record = {"after": order["kill_after"]}
    out = Path(order["out"])
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None,
                      local_directory=order["scratch"]) as made, Client(made, set_as_default=False) as client:
        made.wait_for_workers(2)
        killer = threading.Thread(target=kill_one, args=(client, out, record))
        killer.start()
        with on_cluster(made.scheduler_address):
            evaluate(order["localizer"], "Corridor-v0", walks=order["walks"], out=out, seeds=1)
        killer.join()
        record["ended"] = len(Path(os.environ["CORRIDOR_LOADS"]).read_text().splitlines())
    print(json.dumps(record))

if __name__ == "__main__":
    order = json.loads(sys.argv[1])
    sys.path[:] = order["path"]
    main(order)
"""


def test_a_cluster_gives_the_same_bytes_though_a_worker_is_killed(
    localizer: Callable[[str], str], plugin_root: Path, tmp_path: Path, orphans: Any
) -> None:
    pytest.importorskip("distributed", reason="pip install 'pdrbench[cluster]'")
    out, loads, script = tmp_path / "out", tmp_path / "loads", tmp_path / "sweep.py"
    script.write_text(SCRIPT)  # workers import the script again
    order = {
        "path": [str(plugin_root), *sys.path],
        "out": str(out),
        "scratch": str(tmp_path / "scratch"),
        "localizer": localizer("Noisy"),
        "walks": WALKS,
        "kill_after": KILL_AFTER,
    }
    with orphans() as adopted:
        ended = subprocess.run(
            [sys.executable, str(script), json.dumps(order)],
            env=os.environ | {"CORRIDOR_LOADS": str(loads), "PYTHONPATH": os.pathsep.join(order["path"])},
            capture_output=True,
            text=True,
            timeout=240,
            check=False,
        )
        assert ended.returncode == 0, ended.stderr[-3000:]
        assert adopted.left() == [], "no process of the cluster or the sweep is left behind"
    record = json.loads(ended.stdout.splitlines()[-1])
    assert record["workers"] == 2
    stored_walks = {store.load(out / name).walk for name in record["stored"]}
    begun = [line.split()[0] for line in loads.read_text().splitlines()[: record["ended"]]]
    assert not stored_walks & set(begun[record["begun"] :]), "nothing that was stored is computed again"
    assert len(begun) <= WALKS + 1, "but for the walk that the worker had in hand"
    assert [path.name for path in out.iterdir() if path.suffix != store.SUFFIX] == [".locks"]
    here = evaluate(localizer("Noisy"), "Corridor-v0", walks=WALKS, isolation="none", seeds=1)
    there = load_results(out)
    assert [r.walk for r in there.results] == [r.walk for r in here.results], "nothing is lost"
    for one, other in zip(there.results, here.results, strict=True):
        assert one.estimates.xy_m.tobytes() == other.estimates.xy_m.tobytes()


def test_a_scheduler_that_does_not_answer_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="pip install 'pdrbench[cluster]'")
    monkeypatch.setattr(cluster, "CONNECT_S", 0.3)
    with (
        pytest.raises(ClusterError, match=r"no Dask scheduler answers at 'tcp://127.0.0.1:1'"),
        on_cluster("tcp://127.0.0.1:1"),
    ):
        pass


def test_a_scheduler_that_dies_meanwhile_is_an_error_that_says_what_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[bool] = []

    class Client:
        def close(self) -> None:
            closed.append(True)

        def wait_for_workers(self, count: int, timeout: float) -> None:
            pass

        def run(self, call: Callable[[str], str], name: str) -> dict[str, str]:
            return {"worker": call(name)}

    monkeypatch.setattr(cluster, "_connect", lambda _: Client())
    monkeypatch.setattr(joblib, "parallel_config", lambda **_: contextlib.nullcontext())
    with pytest.raises(ClusterError, match=r"tcp://there does not answer any more.*stored already is kept"):  # noqa: SIM117
        with on_cluster("tcp://there"):
            raise CancelledError  # what Dask raises for every walk that it has not finished
    assert closed == [True]


def test_missing_software_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"pip install 'pdrbench\[cluster\]'"), on_cluster("tcp://127.0.0.1:1"):
        pass


@pytest.mark.parametrize(
    ("options", "message"), [({"jobs": 2}, "a cluster has its own workers"), ({"isolation": "none"}, "have threads")]
)
def test_options_that_a_cluster_does_not_support_are_refused(
    localizer: Callable[[str], str], options: dict[str, Any], message: str
) -> None:
    with joblib.parallel_config(backend="threading"), pytest.raises(PdrbenchError, match=message):
        evaluate(localizer("Good"), "Corridor-v0", walks=1, **options)
