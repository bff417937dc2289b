"""`submit verify --rerun`, `leaderboard verify`: submissions are run again, confined, and compared by score and place.

Nothing that a sender says is believed that can be found out. Every walk is played with the nonce that was sent, which
has to come to what was sent (`agreement`), and with a second nonce, whose estimates, times and memory are published.
"""

from __future__ import annotations

import contextlib
import datetime
import hashlib
import math
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.errors import BundleError
from pdrbench.evaluation import Results, evaluate
from pdrbench.evaluation.origin import machine, versions
from pdrbench.evaluation.protocol import TRIED_WALKS
from pdrbench.evaluation.store import make_folder, write_whole
from pdrbench.process.launch import CONFINED
from pdrbench.registry import localizer_entry
from pdrbench.result import COMPLETE, FAILED, UNSUITABLE, of_division
from pdrbench.settings import split_name
from pdrbench.task import HELD_OUT
from pdrbench_leaderboard.agreement import disagreement
from pdrbench_leaderboard.bundle import Bundle
from pdrbench_leaderboard.entry import (
    Entry,
    encode_results,
    folder_name,
    isolation_ways,
    last_line,
    verified_entry,
    walk_record,
)
from pdrbench_leaderboard.folders import Supplies, unpack_source
from pdrbench_leaderboard.held_out import LOOP_RANKING, held_out_scores
from pdrbench_leaderboard.pack import has_data, suite_budget
from pdrbench_leaderboard.prefixes import check_prefixes
from pdrbench_leaderboard.signing import sign
from pdrbench_leaderboard.suites import Suite, find_suite
from pdrbench_leaderboard.verification import (
    HELD_OUT_FILE,
    REPRODUCED,
    SPOT_CHECKED,
    VERIFIED,
    HeldOut,
    Verification,
)

FIRST, SECOND, UNSEEN, ONCE_MORE = "first", "second", "unseen", "once more"  # runs of an entry
CANARIES: Final = (UNSEEN, SECOND)  # runs of one walk of which the beginning is played to a copy of the localizer
AGAIN: Final = "again"  # folder of what is played once more: it would be found among the results as what it repeats


@dataclass(frozen=True, slots=True)
class Terms:
    """How entries are run again."""

    nonce: str  # of the second run; no sender knew it
    secrets: tuple[str, ...] = ()  # behind held-out walks, one of them of each environment; none leaves them out
    share: float = 1.0  # of the walks of each environment; below 1 a spot check is made and nothing else
    draw: np.random.Generator | None = None  # chooses the walks of a spot check; no sender can know which
    # Folder that keeps every walk, so that a run that was stopped goes on; on a cluster, all machines see it
    results: Path | None = None
    key: Path | None = None  # private key that signs what was found; None: nothing is signed
    supplies: Supplies = field(default_factory=Supplies)  # wheels and weights for a folder


@dataclass(frozen=True, slots=True)
class Verified:
    """What came of running an entry again."""

    entry: Entry  # with the tier that it has earned, where that was signed
    differences: tuple[str, ...] = ()  # what is not as it was sent
    record: Verification | None = None  # what was found; None where anything differs


def verify(bundle: Bundle, terms: Terms, **options: Any) -> list[Verified]:
    """Runs a bundle again; its source never runs in this process.

    Args:
        bundle: From `load_bundle`.
        terms: How.
        options: Of `evaluate`: jobs, budget, progress.

    Returns:
        One for each environment.

    Raises:
        BundleError: It cannot be run again here.
        OtherSecretError: No secret is that of an environment.
        PdrbenchError: As `evaluate`.
    """
    if not 0 < terms.share <= 1:
        raise BundleError(f"the share of walks to run again is above 0 and at most 1; got {terms.share:g}")
    with runnable(bundle, terms) as spec:
        answered = _answered_after_all(bundle, spec, terms, options)
        found = [verify_environment({spec: entry}, terms, **options)[spec] for entry in bundle.entries()]
    if answered:
        return [
            Verified(entry, (*one.differences, *answered)) for one, entry in zip(found, bundle.entries(), strict=True)
        ]
    return found


def verify_environment(entries: Mapping[str, Entry], terms: Terms, **options: Any) -> dict[str, Verified]:
    """Runs entries of one suite and one environment again, side by side: a recording is made once for all of them.

    Args:
        entries: By what `evaluate` runs.
        terms: How.
        options: Of `evaluate`.
    """
    first = next(iter(entries.values()))
    suite = find_suite(first.suite)
    secret = suite.secret_of(first.env, terms.secrets)
    plans = {spec: _runs(entry, suite, secret, terms) for spec, entry in entries.items()}
    groups: dict[bytes, tuple[str, dict[str, Any], list[str]]] = {}
    for spec, plan in plans.items():
        for name, arguments in plan.items():
            groups.setdefault(_key(arguments), (name, arguments, []))[2].append(spec)
    played = {}
    for key, (name, arguments, specs) in groups.items():
        with suite_budget(terms.results, f"{suite.name} {name}") as budget:
            of_group = evaluate(
                specs, first.env, suite_budget=budget, isolation=CONFINED, **arguments, **options
            ).results
        for spec in specs:
            of_spec = of_division([one for one in of_group if one.localizer == spec], entries[spec].division)
            played[key, spec] = Results(of_spec, secret=arguments.get("secret"))
    found = {}
    for spec, entry in entries.items():
        runs = {name: played[_key(arguments), spec] for name, arguments in plans[spec].items()}
        differences = [*_differences(entry, runs, suite), *_unseen_differences(entry, runs, suite)]
        if not differences:
            differences += _canaries(entry, runs, terms)
        found[spec] = Verified(entry, tuple(differences)) if differences else _signed(entry, runs, suite, terms)
    return found


def _runs(entry: Entry, suite: Suite, secret: str | None, terms: Terms) -> dict[str, dict[str, Any]]:
    """Arguments of `evaluate` for each run of an entry."""
    seeds = 1 + max(walk.seed for walk in entry.record.walks)
    common: dict[str, Any] = {"out": terms.results}
    walks = list(dict.fromkeys(walk.walk for walk in entry.record.walks))
    public = {**common, "split": "test", "walks": walks, "seeds": seeds}
    first = {**public, "nonce": entry.manifest.nonce}
    if terms.share < 1:
        count = max(1, math.ceil(terms.share * len(walks) - 1e-9))
        draw = terms.draw or np.random.default_rng()
        return {FIRST: {**first, "walks": [walks[at] for at in sorted(draw.choice(len(walks), count, replace=False))]}}
    runs = {SECOND: {**public, "nonce": terms.nonce}}
    if not entry.record.deterministic:  # the second run of one that is has to come to what was sent
        runs[FIRST] = first
    if secret is not None:
        seeds = 1 if entry.record.deterministic else suite.seeds
        held_out = {"split": HELD_OUT, "secret": secret, "walks": suite.held_out_walks}
        unseen = {**common, **held_out, "seeds": seeds}
        elsewhere = None if terms.results is None else terms.results / AGAIN
        runs |= {UNSEEN: unseen, ONCE_MORE: {**unseen, "seeds": 1, "out": elsewhere}}
    return runs


def _key(arguments: Mapping[str, Any]) -> bytes:
    """The same for runs that can be made together."""
    return msgspec.json.encode(sorted((name, str(value)) for name, value in arguments.items()))


def _signed(entry: Entry, runs: Mapping[str, Results], suite: Suite, terms: Terms) -> Verified:
    """What the runs of an entry say of it, all of which gave what they should."""
    held_out = None
    if UNSEEN in runs:
        held_out, estimates = held_out_scores(runs[UNSEEN], suite)
        if terms.results is not None:  # published when the round is over: they lie near the truth
            folder = make_folder(terms.results / "held_out" / entry.env / folder_name(entry.localizer))
            write_whole(folder / HELD_OUT_FILE, estimates)
    record = _record(entry, runs, held_out, terms)
    if terms.key is None:
        return Verified(entry, record=record)
    rerun = encode_results(runs[SECOND].results) if record.walks else b""
    return Verified(verified_entry(entry, record, rerun, sign(record, terms.key)), record=record)


def _metric(suite: Suite, results: Results) -> str:
    """What runs are compared by: the metric that ranks, where it applies."""
    applies = any(np.isfinite(scored.scores.get(suite.metrics[0], np.nan)) for scored in results.scored)
    return suite.metrics[0] if applies else LOOP_RANKING


def _unseen_differences(entry: Entry, runs: Mapping[str, Results], suite: Suite) -> Iterator[str]:
    """What is wrong with the runs on held-out walks."""
    if UNSEEN not in runs:
        return
    unseen = runs[UNSEEN]
    walks = list(dict.fromkeys(result.walk for result in unseen.results))
    for what in disagreement(unseen, runs[ONCE_MORE], _metric(suite, unseen)):
        for number, walk in enumerate(walks, 1):  # whose names are secret
            what = what.replace(f"walk {walk},", f"held-out walk {number},")
        yield f"{entry.env}: not the same twice; {what}"
    divisions = {result.division for result in unseen.results if result.status not in (FAILED, UNSUITABLE)}
    if divisions - {entry.division}:
        yield f"{entry.env}: {entry.division} on public walks, {' and '.join(sorted(divisions))} on held-out ones"


def _canaries(entry: Entry, runs: Mapping[str, Results], terms: Terms) -> Iterator[str]:
    """Walks whose beginning is answered otherwise where it ends earlier: whoever does that knows the future."""
    rng = np.random.default_rng(int(terms.nonce or "0", 16))
    for name in CANARIES:
        whole = [result for result in runs[name].results if result.status == COMPLETE] if name in runs else []
        if whole:
            result = whole[int(rng.integers(len(whole)))]
            found = check_prefixes(result, rng, secret=runs[name].secret)
            if found.difference is not None:
                what = "a held-out walk" if name == UNSEEN else f"walk {result.walk}"
                yield f"{entry.env}: it knows the future; the beginning of {what} {found.difference}"


def _differences(entry: Entry, runs: Mapping[str, Results], suite: Suite) -> Iterator[str]:
    """What the runs with public walks did not come to as it was sent."""
    played, sent = runs.get(FIRST) or runs[SECOND], Results(entry.sent)
    differing = [f"{entry.env}: {what}" for what in disagreement(sent, played, _metric(suite, sent))]
    yield from differing
    if differing and FIRST not in runs:
        yield (
            f"{entry.env}: it says that it draws no random numbers, and one seed was sent; with another nonce its "
            "estimates differ. One that draws is packed with every seed"
        )


def _record(entry: Entry, runs: Mapping[str, Results], held_out: HeldOut | None, terms: Terms) -> Verification:
    """What was found of an entry of which every run came to what was sent."""
    published = (runs.get(SECOND) or runs[FIRST]).results
    is_spot_check = SECOND not in runs
    return Verification(
        schema=2,
        suite=entry.suite,
        env=entry.env,
        localizer=entry.localizer,
        entry_sha256=entry.sha256,
        tier=SPOT_CHECKED if is_spot_check else REPRODUCED if held_out is None else VERIFIED,
        date=datetime.datetime.now(datetime.UTC).date(),
        nonce="" if is_spot_check else terms.nonce,
        reran=len(published),
        of=len(entry.record.walks),
        versions=versions(),
        machine=machine(),
        isolation=isolation_ways(published),
        walks=() if is_spot_check else tuple(map(walk_record, published)),
        estimates_sha256=None if is_spot_check else hashlib.sha256(encode_results(published)).hexdigest(),
        held_out=held_out,
    )


def _answered_after_all(bundle: Bundle, spec: str, terms: Terms, options: Mapping[str, Any]) -> list[str]:
    """Environments that a bundle says its localizer declines, and that it answers."""
    manifest, found = bundle.manifest, []
    for env in filter(has_data, sorted(manifest.unsuitable)):
        walks = min(TRIED_WALKS, find_suite(manifest.suite).environment(env).walks)
        arguments: dict[str, Any] = {"split": "test", "walks": walks, "seeds": 1, "nonce": manifest.nonce}
        tried = evaluate(spec, env, out=terms.results, isolation=CONFINED, **arguments, **options)
        answers = [result for result in tried.results if result.status != UNSUITABLE]
        if answers:
            why = f" ({last_line(answers[0].failure)})" if answers[0].failure else ""
            found.append(f"{env}: declined according to the bundle, {answers[0].status} when it is run{why}")
    return found


@contextlib.contextmanager
def runnable(bundle: Bundle, terms: Terms) -> Iterator[str]:
    """What `evaluate` runs: a registered id, an installed class, or what was packed in a folder of its own."""
    manifest = bundle.manifest
    if manifest.source:
        place = split_name(manifest.spec)[0].partition(":")[0]
        if place not in bundle.source:
            raise BundleError(f"the bundle runs {place!r}, which is not in its source")
        with tempfile.TemporaryDirectory(prefix="pdrbench-source-") as temporary:
            folder = Path(temporary)
            if terms.results is not None:  # results are kept by the place of what made them
                beside = terms.results.absolute().with_name(f"{terms.results.name}.source")
                folder = beside / bundle.content_sha256[:16]
                folder.mkdir(parents=True, exist_ok=True)
            yield unpack_source(bundle.source, manifest.spec, folder, terms.supplies)
        return
    if ":" not in manifest.spec:
        localizer_entry(*split_name(manifest.spec))  # raises where it is not registered
    if manifest.spec.partition(":")[0].endswith(".py"):
        raise BundleError(f"{manifest.spec} travels without its source: ask its authors to pack it again with it")
    yield manifest.spec
