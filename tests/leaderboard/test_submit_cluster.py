"""`pdrbench submit pack` and `verify` with their walks on a real Dask cluster of two processes."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pdrbench.evaluation import jobs
from pdrbench_leaderboard.bundle import Bundle, read_bundle, write_bundle
from pdrbench_leaderboard.card import card_toml
from pdrbench_leaderboard.suites import Suite

from .conftest import SECRET, card_named
from .test_submit_commands import call, call_json
from .test_verify import tampered

END_S = 10.0
START_S = 60.0  # for interpreters that import Dask, on a busy machine


@dataclass(frozen=True)
class Cluster:
    """A scheduler, and a client that looks at its workers."""

    address: str
    client: Any

    def num_used(self) -> int:
        """Workers that have played walks."""
        return sum(self.client.run(num_remembered).values())


def num_remembered() -> bool:
    """In a worker: whether it has read the sources of a localizer."""
    return bool(jobs._memory())


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    distributed = pytest.importorskip("distributed", reason="pip install 'pdrbench[cluster]'")
    folder = tmp_path_factory.mktemp("cluster")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    started: list[subprocess.Popen[bytes]] = []

    def start(*arguments: str) -> None:
        with (folder / f"{len(started)}.log").open("wb") as log:
            command = [sys.executable, "-m", "dask", *arguments]
            started.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=Path.cwd()))

    found = folder / "scheduler.json"
    try:
        start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(found))
        ends_s = time.monotonic() + START_S
        while not found.exists() and time.monotonic() < ends_s:
            time.sleep(0.05)
        with distributed.Client(scheduler_file=str(found), timeout=START_S, set_as_default=False) as client:
            address = client.scheduler.address
            for name in ("one", "two"):
                options = ("--nworkers", "1", "--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory")
                start("worker", address, *options, str(folder / name))
            client.wait_for_workers(2, timeout=START_S)
            assert len(set(client.run(os.getpid).values()) - {os.getpid()}) == 2
            yield Cluster(address, client)
    finally:
        for process in reversed(started):  # one by one: a worker waits for a scheduler that leaves at the same time
            process.terminate()
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.mark.long(seconds=15)
def test_a_bundle_that_a_cluster_packed_is_the_one_packed_here(
    cluster: Cluster, packed: dict[str, Bundle], small_suite: Suite, submitted: Path, tmp_path: Path
) -> None:
    card, file = tmp_path / "card.toml", tmp_path / "there.pdrz"
    card.write_bytes(card_toml(card_named("wanders-v0")))
    nonce = packed["Wanders"].manifest.nonce
    printed = call_json(
        *("pack", f"{submitted}:Wanders", "--suite", small_suite.name, "--card", card, "--out", file),
        *("--nonce", nonce, "--scheduler", cluster.address),
    )
    assert (printed["bundles"][0]["runs"], printed["bundles"][0]["failed"]) == (4, 0)
    assert cluster.num_used() > 0
    there, here = read_bundle(file.read_bytes()), packed["Wanders"]
    assert [whole.tobytes() for whole in there.estimates] == [whole.tobytes() for whole in here.estimates]
    walks = [record.walks for record in here.manifest.environments]
    assert [record.walks for record in there.manifest.environments] == walks


@pytest.mark.long
def test_a_cluster_verifies_a_good_bundle_and_refuses_one_changed_estimate(
    cluster: Cluster, packed: dict[str, Bundle], tmp_path: Path
) -> None:
    good, bad, secret = tmp_path / "good.pdrz", tmp_path / "bad.pdrz", tmp_path / "secret.txt"
    good.write_bytes(write_bundle(packed["Wanders"]))
    bad.write_bytes(write_bundle(tampered(packed["Wanders"], run=3, row=7, change=1)))
    secret.write_text(SECRET)
    options = ("--rerun", "--scheduler", cluster.address)
    (row,) = call_json("verify", good, *options, "--secret", secret)["entries"]
    assert (row["found"], row["reran"], row["of"], row["deterministic"]) == ("verified", 4, 4, False)
    assert cluster.num_used() > 0
    walk = packed["Wanders"].manifest.environments[0].walks[3].walk
    refused = call("verify", bad, *options)
    assert refused.exit_code == 1
    assert f"BuildingSite-v1, walk {walk}, seed 1: 1 of" in str(refused.exception)
