"""Walks of generated environments of the laboratory against thinned copies, under narrower kernels.

The copies are written by `python tests/samples/thinned.py write tests/lab/environments/walks ENV/WALK...`.
"""

from __future__ import annotations

import json
from pathlib import Path

from thinned import assert_same, check_elsewhere

from pdrbench.registry import environments, make_task

COPIES = Path(__file__).parent / "walks"


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
    assert_same(check_elsewhere(COPIES, names, {"NPY_DISABLE_CPU_FEATURES": " ".join(wide), **core}))
