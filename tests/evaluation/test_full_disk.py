"""A disk that fills up in the middle of a sweep: an error in one line, and stored results stay whole."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

WALKS = 8
DISK_BYTES = 1 << 20
# Runs inside a mount namespace, on a file system of 1 MiB that vanishes with it; prints what it saw as JSON.
SCRIPT = """
import json, sys
from pathlib import Path
order = json.loads(sys.argv[1])
sys.path[:] = order["path"]
import numpy as np
from pdrbench.errors import PdrbenchError
from pdrbench.evaluation import evaluate, load_results, store

out, filler, loads = Path(order["out"]), Path(order["out"]) / "filler", Path(order["loads"])
rng = np.random.default_rng(order["seed"])

def fill(spare_bytes):
    block = bytes(4096)
    with filler.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(block)
        except OSError:
            pass
        file.truncate(max(0, file.tell() - spare_bytes))

def stored():
    return {path.name: path.read_bytes() for path in out.glob("*" + store.SUFFIX)}

def computed():
    return [line.split()[0] for line in loads.read_text().splitlines()] if loads.exists() else []

rounds = []
for round in range(order["rounds"]):
    for path in out.glob("*" + store.SUFFIX):
        path.unlink()
    while True:
        before, begun = stored(), len(computed())
        walks_before = {store.load(out / name).walk for name in before}
        fill(4096 * int(rng.integers(2, 8)))
        error = ""
        try:
            evaluate(order["localizer"], "Corridor-v0", walks=order["walks"], jobs=order["jobs"], out=out, seeds=1)
        except PdrbenchError as failure:
            error = str(failure)
        filler.unlink()
        now = stored()
        rounds.append({
            "error": error,
            "same": all(now.get(name) == content for name, content in before.items()),
            "readable": all(store.load(out / name).status == "complete" for name in now),
            "again": sorted(walks_before & set(computed()[begun:])),
            "left": [path.name for path in out.iterdir() if path.suffix not in (store.SUFFIX, "") and path != filler],
            "stored": len(now),
        })
        if len(now) == order["walks"]:
            break
print(json.dumps(rounds))
"""


def namespace_missing() -> str:
    """Why a small disk cannot be made here; empty where it can."""
    if sys.platform != "linux" or shutil.which("unshare") is None:
        return "a file system for one process needs Linux and unshare(1)"
    command = [*IN_NAMESPACE, "mount -t tmpfs -o size=1m none /mnt"]
    tried = subprocess.run(command, capture_output=True, text=True, check=False)
    return tried.stderr.strip() if tried.returncode else ""


IN_NAMESPACE = ("unshare", "--user", "--map-root-user", "--mount", "sh", "-c")


def test_a_full_disk_loses_and_tears_nothing(
    localizer: Callable[[str], str], plugin_root: Path, tmp_path: Path
) -> None:
    """Space runs out after a random number of bytes; then it is freed, and the same sweep continues."""
    missing = namespace_missing()
    if missing:
        pytest.skip(f"no small disk here: {missing}")
    out, loads = tmp_path / "out", tmp_path / "loads"
    out.mkdir()
    order = {
        "path": [str(plugin_root), *sys.path],
        "out": str(out),
        "loads": str(loads),
        "localizer": localizer("Good"),
        "walks": WALKS,
        "rounds": 1,
        "jobs": 1,
        "seed": 10,
    }
    script = f'mount -t tmpfs -o size={DISK_BYTES} none "{out}" && exec "$0" -c "$1" "$2"'
    ended = subprocess.run(
        [*IN_NAMESPACE, script, sys.executable, SCRIPT, json.dumps(order)],
        env=os.environ | {"CORRIDOR_LOADS": str(loads)},
        capture_output=True,
        text=True,
        timeout=800,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr[-3000:]
    seen = json.loads(ended.stdout.splitlines()[-1])
    assert sum(bool(sweep["error"]) for sweep in seen) >= 1, "fewer pages are free than there are walks"
    for sweep in seen:
        assert sweep["same"] and sweep["readable"], "what is stored stays as it is, and is whole"
        assert sweep["again"] == [], "nothing that is stored is computed again"
        assert not sweep["error"] or ("cannot write" in sweep["error"] and "\n" not in sweep["error"])
        assert not [name for name in sweep["left"] if name.endswith(".tmp")], sweep["left"]
    assert seen[-1]["stored"] == WALKS
