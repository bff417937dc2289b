"""`submit verify --rerun`: runs a submission again, isolated, and compares the estimates byte for byte."""

from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.errors import BundleError
from pdrbench.evaluation import evaluate
from pdrbench.evaluation.sources import versions
from pdrbench.registry import LOCALIZERS_GROUP, find_entry, make_task
from pdrbench.result import UNSUITABLE, Result
from pdrbench.task import HELD_OUT, commitment
from pdrbench.trajectory import ESTIMATE_COLUMNS
from pdrbench_leaderboard import coding
from pdrbench_leaderboard.bundle import Bundle
from pdrbench_leaderboard.entry import Entry, walk_record
from pdrbench_leaderboard.folders import Supplies, unpack_source
from pdrbench_leaderboard.manifest import REPRODUCED, VERIFIED, EnvironmentRecord, HeldOut, Verification, WalkRecord
from pdrbench_leaderboard.suites import Suite, find_suite

NO_SUPPLIES: Final = Supplies()
WHY: Final = "a maintainer runs an entry again"  # of a look at a sealed split


def verify(
    bundle: Bundle,
    rng: np.random.Generator,
    *,
    share: float = 0.2,
    secret: str | None = None,
    results: Path | None = None,
    supplies: Supplies = NO_SUPPLIES,
    **options: Any,
) -> tuple[list[str], list[Entry]]:
    """Runs a fraction of a bundle again; its source never runs in this process.

    Args:
        bundle: From `load_bundle`.
        rng: Chooses the walks; a submitter cannot know which.
        share: Fraction of the walks of each environment, at least one walk; 1 for all.
        secret: Behind the held-out walks of the suite; None leaves them out.
        results: Folder that keeps every walk, so that a run that was stopped goes on; the source is put beside it. On
            a cluster, all machines see it.
        supplies: Wheels and weights for a folder.
        options: Of `evaluate`: jobs, isolation, budget, progress.

    Returns:
        differences: Runs that did not give the estimates that were packed, with the first thing that differs.
        entries: With the tier that they have earned.

    Raises:
        BundleError: It cannot be run again here, or the secret is another suite's.
        PdrbenchError: As `evaluate`.
    """
    if not 0 < share <= 1:
        raise BundleError(f"the share of walks to run again is above 0 and at most 1; got {share:g}")
    suite = find_suite(bundle.manifest.suite)
    if secret is not None and commitment(secret) != suite.commitment:
        raise BundleError(f"this is not the secret behind the held-out walks of {suite.name}: its sha256 differs")
    entries = bundle.entries()
    common: dict[str, Any] = {"parameters": dict(bundle.manifest.parameters), **options}
    with _runnable(bundle, results, supplies) as spec:
        differences: list[str] = []
        found = []
        for entry in entries:
            again, differing = _rerun(spec, entry, rng, share, {**common, "out": results})
            differences += differing
            twice = _runs_the_same_twice(spec, again[0], common)
            held_out = None
            if secret is not None and not differing and make_task(entry.env).held_out is not None:
                held_out = _held_out(spec, entry.record, suite, secret, bundle.manifest.seeds, common)
            found.append(entry if differing else _verified(entry, again, twice, held_out))
    return differences, found


@contextlib.contextmanager
def _runnable(bundle: Bundle, results: Path | None, supplies: Supplies) -> Iterator[str]:
    """What `evaluate` runs: a registered id, an installed class, or the packed file in a folder of its own."""
    manifest = bundle.manifest
    if manifest.source:
        place = manifest.spec.partition(":")[0]
        if place not in bundle.source:
            raise BundleError(f"the bundle runs {place!r}, which is not in its source")
        with tempfile.TemporaryDirectory(prefix="pdrbench-source-") as temporary:
            folder = Path(temporary)
            if results is not None:  # results are kept by the place of what made them
                folder = results.absolute().with_name(f"{results.name}.source") / bundle.content_sha256[:16]
                folder.mkdir(parents=True, exist_ok=True)
            yield unpack_source(bundle.source, manifest.spec, folder, supplies)
        return
    if ":" not in manifest.spec:
        find_entry(LOCALIZERS_GROUP, "localizer", manifest.spec)  # raises where it is not registered
    if manifest.spec.partition(":")[0].endswith(".py"):
        raise BundleError(f"{manifest.spec} travels without its source: ask its authors to pack it again with it")
    yield manifest.spec


def _rerun(
    spec: str, entry: Entry, rng: np.random.Generator, share: float, options: Mapping[str, Any]
) -> tuple[Sequence[Result], list[str]]:
    """Some walks of an environment with all of their seeds."""
    walks = list(dict.fromkeys(walk.walk for walk in entry.record.walks))
    count = max(1, math.ceil(share * len(walks) - 1e-9))
    chosen = [walks[index] for index in sorted(rng.choice(len(walks), count, replace=False).tolist())]
    seeds = 1 + max(walk.seed for walk in entry.record.walks)
    played = evaluate(spec, entry.env, split="test", why=WHY, walks=chosen, seeds=seeds, **options).results
    packed = {
        (walk.walk, walk.seed): (walk, result) for walk, result in zip(entry.record.walks, entry.results, strict=True)
    }
    differences = []
    for result in played:
        if (result.walk, result.seed) not in packed:
            continue
        walk, before = packed[result.walk, result.seed]
        what = _difference(result, walk, before)
        if what:
            differences.append(f"{entry.env}, walk {result.walk}, seed {result.seed}: {what}")
    return played, differences


def _difference(result: Result, packed: WalkRecord, before: Result) -> str:
    """The first thing in which a run differs from what was packed; empty where nothing does."""
    whole = coding.whole_numbers(result.estimates)
    again = walk_record(result, whole)
    if again.status != packed.status:
        last = (result.failure.strip().splitlines() or [""])[-1][:200]
        return f"was {packed.status}, is {again.status}{f' ({last})' if last else ''}"
    if again.sha256 != packed.sha256:
        return first_difference(coding.whole_numbers(before.estimates), whole, make_task(result.env).period_s)
    if again != packed:
        return f"was {msgspec.to_builtins(packed)}, is {msgspec.to_builtins(again)}"
    return ""


def first_difference(packed: coding.Whole, again: coding.Whole, period_s: float) -> str:
    """Where two runs part."""
    rows = min(packed.shape[1], again.shape[1])
    parted = np.flatnonzero((packed[:, :rows] != again[:, :rows]).any(axis=0))
    if not len(parted):
        return f"{packed.shape[1]} estimates were packed, {again.shape[1]} came"
    row = int(parted[0])
    column = int(np.flatnonzero(packed[:, row] != again[:, row])[0])
    was, now = (coding.from_whole_numbers(one[:, row : row + 1], period_s) for one in (packed, again))
    values = [one.columns[column, 0] for one in (was, now)]
    return (
        f"{len(parted)} of {rows} estimates differ, the first at {row * period_s:g} s: "
        f"{ESTIMATE_COLUMNS[column]} was {values[0]:.10g}, is {values[1]:.10g}"
    )


def _runs_the_same_twice(spec: str, first: Result, options: Mapping[str, Any]) -> bool:
    """Whether one walk with one seed gives the same bytes once more."""
    once_more: dict[str, Any] = {"split": "test", "why": WHY, "walks": [first.walk], "seeds": first.seed + 1}
    again = evaluate(spec, first.env, **once_more, **options).results[-1]
    return coding.digest(coding.whole_numbers(again.estimates)) == coding.digest(coding.whole_numbers(first.estimates))


def _held_out(
    spec: str, record: EnvironmentRecord, suite: Suite, secret: str, seeds: int, options: Mapping[str, Any]
) -> HeldOut | None:
    """Scores on held-out walks; None where the localizer declines all of them."""
    seeds = 1 if record.deterministic else seeds
    results = evaluate(
        spec, record.env, split=HELD_OUT, secret=secret, walks=suite.held_out_walks, seeds=seeds, **options
    )
    if all(result.status == UNSUITABLE for result in results.results):
        return None
    row = results.rows()[0]
    metrics = {name: row["metrics"][name] for name in suite.metrics if name in row["metrics"]}
    return HeldOut(
        commitment=suite.commitment,
        walks=row["walks"],
        seeds=row["seeds"],
        metrics={name: (value["value"], value["low"], value["high"]) for name, value in metrics.items()},
    )


def _verified(entry: Entry, results: Sequence[Result], twice: bool, held_out: HeldOut | None) -> Entry:
    """The entry with the tier that it has earned."""
    ways: list[Any] = [result.provenance.get("isolation") or {} for result in results]
    verification = Verification(
        reran=len(results),
        of=len(entry.record.walks),
        is_deterministic=twice,
        isolation=", ".join(sorted({str(dict(way).get("mode", "")) for way in ways})),
        versions=versions(),
        held_out=held_out,
    )
    tier = REPRODUCED if held_out is None else VERIFIED
    submission = msgspec.structs.replace(entry.submission, tier=tier, verification=verification)
    return replace(entry, submission=submission)
