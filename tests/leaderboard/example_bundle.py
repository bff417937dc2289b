"""A made-up bundle, for tests and for the fuzzer of the readers."""

from __future__ import annotations

import hashlib

import numpy as np

from pdrbench.registry import make_task
from pdrbench.result import Result
from pdrbench.trajectory import ESTIMATE_COLUMNS
from pdrbench_leaderboard import coding
from pdrbench_leaderboard.bundle import Bundle
from pdrbench_leaderboard.card import EXAMPLE, card_toml
from pdrbench_leaderboard.entry import walk_record
from pdrbench_leaderboard.manifest import SCHEMA, EnvironmentRecord, Manifest, RunRecord, WalkRun

ENV = "OfficeStride-v2"
EMPTY_SHA256 = hashlib.sha256(b"").hexdigest()


def example() -> Bundle:
    """A small sound bundle: two walks of twenty estimates, a source file."""
    task = make_task(ENV)
    rng = np.random.default_rng(9)
    results = []
    for walk in task.split("test")[:2]:
        whole = rng.integers(-10_000, 10_000, (len(ESTIMATE_COLUMNS), 20))
        whole[coding.CONVERGED] = coding.NAN
        estimates = coding.from_whole_numbers(whole, task.period_s)
        results.append(Result(task.id, "test", walk, "mine-v0", 0, estimates, np.full(20, 1e-3), missing={"nan": 1}))
    wholes = tuple(coding.whole_numbers(result.estimates) for result in results)
    record = EnvironmentRecord(
        env=ENV,
        split="test",
        period_s=task.period_s,
        deterministic=True,
        walks=tuple(walk_record(result, whole) for result, whole in zip(results, wholes, strict=True)),
    )
    run = RunRecord(
        started_at="2026-01-01T00:00:00+00:00",
        machine={"cpu": "one", "cores": 2},
        isolation=({"mode": "process"},),
        budget={"pace": 2.0},
        walks={ENV: tuple(WalkRun(reset_s=0.1, step_times=coding.time_counts(result.step_s)) for result in results)},
    )
    source = {"mine.py": b"class Mine: ...\n"}
    manifest = Manifest(
        schema=SCHEMA,
        suite="pdr-core-v2",
        localizer=EXAMPLE.name,
        spec="mine.py:Mine",
        seeds=1,
        nonce="",
        versions={"pdrbench": "0"},
        core_sha256=EMPTY_SHA256,
        localizer_sha256=EMPTY_SHA256,
        card_sha256=hashlib.sha256(card_toml(EXAMPLE)).hexdigest(),
        source={name: hashlib.sha256(content).hexdigest() for name, content in source.items()},
        environments=(record,),
    )
    return Bundle(manifest=manifest, run=run, card=EXAMPLE, estimates=wholes, source=source)


LOCK = f"""\
--index-url https://example.org/simple
foreign==1.0 \\
    --hash=sha256:{"0" * 64} \\
    --hash=sha256:{"1" * 64}
other[extra]==2.0+cpu ; python_version >= "3.8" and sys_platform != "win32" --hash=sha256:{"2" * 64}  # a comment
""".encode()
WEIGHTS = bytes(range(256))
SETTINGS = f"""\
entry = "parts/model.py:Net"
python = "3.11"
requirements = "requirements.txt"
[weights."net.bin"]
bytes = {len(WEIGHTS)}
sha256 = "{hashlib.sha256(WEIGHTS).hexdigest()}"
""".encode()
PROJECT = b'[tool.pdrbench]\nentry = "parts.model:Net"\n'
# What travels with a bundle where the localizer is a folder
LOCALIZER_FOLDER = {
    "localizer.toml": SETTINGS,
    "net.bin": WEIGHTS,
    "parts/model.py": b"class Net: pass\n",
    "pyproject.toml": PROJECT,
    "requirements.txt": LOCK,
}
