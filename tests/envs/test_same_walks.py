"""Generated walks are the same numbers on every processor: stored thinned copies, under three kinds of kernels.

`python tests/samples/thinned.py write tests/envs/walks ENV/WALK...` writes the copies, with the names in `WALKS`.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from thinned import agreement, assert_same, check, check_elsewhere

from pdrbench.datasets import is_available
from pdrbench.recording import Recording, SensorStream
from pdrbench.registry import environments, make_task

COPIES = Path(__file__).parent / "walks"
# Two walks of each environment; those of `CampusPhoneLost-v1` are those with a start, as a test of `campus` has it.
WALKS = {
    "CampusFoot-v1": ("val-00", "val-03"),
    "CampusPhone-v1": ("val-01", "val-09"),
    "CampusStride-v1": ("val-00", "val-05"),
}


def kernels() -> dict[str, tuple[str, str]]:
    """A core of OpenBLAS and features that NumPy does without, two pairs that this processor can run."""
    from numpy._core import _multiarray_umath as numpy_core

    here = {name for name, has in numpy_core.__cpu_features__.items() if has}
    dispatched = [name for name in numpy_core.__cpu_dispatch__ if name in here]
    wide = [name for name in dispatched if "AVX512" in name or name == "X86_V4"]
    cores = [core for core, needs in (("Haswell", "AVX2"), ("SkylakeX", "AVX512_SKX")) if needs in here]
    narrower, least = [*cores, "", ""][:2]
    return {"narrower": (narrower, " ".join(wide)), "least": (least, " ".join(dispatched))}


def walks_at_hand() -> list[str]:
    return [
        f"{env}/{walk}"
        for env, walks in WALKS.items()
        if make_task(env).dataset is None or is_available(str(make_task(env).dataset))
        for walk in walks
    ]


def test_every_generated_environment_has_two_copies() -> None:
    generated = {
        name
        for name, entry in environments().items()
        if entry.package == "pdrbench" and "generated" in make_task(name).source
    }
    assert set(WALKS) == generated - {"CampusPhoneLost-v1"} == {path.stem for path in COPIES.glob("*.json")}
    for env, walks in WALKS.items():
        assert set(json.loads((COPIES / f"{env}.json").read_text())) == set(walks)


def test_walks_are_their_copies() -> None:
    assert_same(check(COPIES, walks_at_hand()))


@pytest.mark.parametrize("kind", ["narrower", "least"])
def test_walks_are_their_copies_whatever_the_kernels(kind: str) -> None:
    core, without = kernels()[kind]
    variables = {"OPENBLAS_CORETYPE": core, "NPY_DISABLE_CPU_FEATURES": without}
    if kind == "least":  # sines of the C library of Linux, too
        variables["GLIBC_TUNABLES"] = "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F"
    assert_same(check_elsewhere(COPIES, walks_at_hand()[kind == "least" :: 2], variables))  # one of each environment


@pytest.fixture(scope="module")
def stored() -> dict[str, Any]:
    copies: dict[str, Any] = json.loads((COPIES / "CampusStride-v1.json").read_text())
    return copies


@pytest.mark.parametrize(
    ("change", "other", "most"),
    [
        (lambda rows: rows + np.array([0, 1e-9, 0, 0]), 0, 0),  # the last bits, and far more
        (lambda rows: rows + np.array([0, 1e-3, 0, 0]), 97, 1),  # a step
        (lambda rows: rows[:-1], 0, 0),
    ],
)
def test_another_walk_is_found(stored: dict[str, Any], change: Any, other: int, most: int) -> None:
    task = make_task("CampusStride-v1")

    def load(walk: str) -> Recording:
        recording = task.load(walk)
        stride = recording.streams["stride"]
        return dataclasses.replace(recording, streams={"stride": SensorStream(stride.spec, change(stride.rows))})

    found = agreement(dataclasses.replace(task, load=load), "val-00", stored["val-00"])
    assert (found["other"], found["most"]) == (other, most)
    assert bool(found["wrong"]) == (len(change(np.zeros((97, 4)))) < 97)
