"""Walks of generated environments of the laboratory against thinned copies, under narrower kernels.

The copies are written by `python -m pdrbench_sim.thinned write tests/lab/environments/walks ENV/WALK...`.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from pdrbench.registry import environments, make_task

COPIES = Path(__file__).parent / "walks"
MAX_OTHER = 1e-5  # fraction of values that may be another whole number, by one step


def test_every_generated_environment_of_the_laboratory_has_two_copies() -> None:
    own = {name for name, entry in environments().items() if entry.package == "pdrbench-lab"}
    generated = {name for name in own if make_task(name).source == "generated"}
    assert {path.stem for path in COPIES.glob("*.json")} == generated
    assert all(len(json.loads(path.read_text())) == 2 for path in COPIES.glob("*.json"))


def test_walks_of_the_laboratory_are_their_copies() -> None:
    from numpy._core import _multiarray_umath as numpy_core

    wide = [name for name in numpy_core.__cpu_dispatch__ if "AVX512" in name or name == "X86_V4"]
    wide = [name for name in wide if numpy_core.__cpu_features__.get(name)]
    core = {"OPENBLAS_CORETYPE": "Haswell"} if numpy_core.__cpu_features__.get("AVX2") else {}
    names = [f"{path.stem}/{walk}" for path in sorted(COPIES.glob("*.json")) for walk in json.loads(path.read_text())]
    done = subprocess.run(
        [sys.executable, "-m", "pdrbench_sim.thinned", "check", str(COPIES), *names],
        env={**os.environ, "NPY_DISABLE_CPU_FEATURES": " ".join(wide), **core},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    assert {walk: one["wrong"] for walk, one in found.items() if one["wrong"]} == {}
    values, other = (sum(one[name] for one in found.values()) for name in ("values", "other"))
    assert other <= math.ceil(MAX_OTHER * values), found
    assert max(one["most"] for one in found.values()) <= 1
