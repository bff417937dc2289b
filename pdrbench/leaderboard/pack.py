"""`submit pack`: runs localizers on a suite and makes a bundle of what each of them answered."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from pdrbench.datasets import find
from pdrbench.errors import BundleError, DatasetError, PdrbenchError
from pdrbench.evaluation import evaluate
from pdrbench.leaderboard import coding
from pdrbench.leaderboard.bundle import Bundle, write_bundle
from pdrbench.leaderboard.card import Card, card_toml
from pdrbench.leaderboard.entry import last_line, walk_record, walk_run
from pdrbench.leaderboard.manifest import EnvironmentRecord, Manifest, Run
from pdrbench.leaderboard.suites import Share, Suite
from pdrbench.registry import make_task
from pdrbench.result import FAILED, OFFLINE, ONLINE, UNSUITABLE, Result
from pdrbench.trajectory import Estimates

TRIED_WALKS: Final = 4  # of each environment: who declines them all declines it; they are of every way of carrying
PROBED_WALKS: Final = 2  # of each environment are run with two seeds, to see whether they matter


@dataclass(frozen=True, slots=True)
class Played:
    """What a localizer answered to one environment.

    Attributes:
        deterministic: Whether two seeds gave the same bytes.
        results: In the order of walks and seeds.
    """

    deterministic: bool
    results: tuple[Result, ...]


@dataclass(frozen=True, slots=True)
class Outing:
    """What a localizer answered to a suite.

    Attributes:
        played: By environment.
        unsuitable: Why it declined, by environment.
        absent: Environments whose recorded data is not at hand.
    """

    played: Mapping[str, Played]
    unsuitable: Mapping[str, str]
    absent: tuple[str, ...]


def play_suite(
    specs: Sequence[str],
    suite: Suite,
    *,
    results: Path | None = None,
    seeds: int | None = None,
    envs: Sequence[str] = (),
    **options: Any,
) -> dict[str, Outing]:
    """Runs localizers on the walks of a suite; those that draw random numbers with every seed.

    Args:
        specs: Ids, `package.module:Class` or `path/to/file.py:Class`.
        suite: Of `suites()`.
        results: Folder that keeps every walk, so that a run that was stopped goes on.
        seeds: Instead of those of the suite.
        envs: Only these environments of the suite; all where empty.
        options: Of `evaluate`: jobs, isolation, budget, progress.

    Raises:
        PdrbenchError: As `evaluate`.
    """
    seeds = suite.seeds if seeds is None else seeds
    played: dict[str, dict[str, Played]] = {spec: {} for spec in specs}
    unsuitable: dict[str, dict[str, str]] = {spec: {} for spec in specs}
    absent = []
    for share in suite.environments:
        if envs and share.env not in envs:
            continue
        if not is_at_hand(share.env):
            absent.append(share.env)
            continue
        found = _play_environment(specs, share, seeds, {"out": results, **options})
        for spec, answered in found.items():
            if isinstance(answered, Played):
                played[spec][share.env] = answered
            else:
                unsuitable[spec][share.env] = answered
    return {spec: Outing(played[spec], unsuitable[spec], tuple(absent)) for spec in specs}


def _play_environment(
    specs: Sequence[str], share: Share, seeds: int, options: Mapping[str, Any]
) -> dict[str, Played | str]:
    """What each localizer answered, or why it declined.

    All of them are run together: a recording is made once for all of them.
    """
    few = min(TRIED_WALKS, share.walks)
    tried = _by_spec(evaluate(specs, share.env, walks=few, **options).results)
    found: dict[str, Played | str] = {spec: last_line(tried[spec][0].failure) for spec in specs}
    suited = [spec for spec in specs if any(result.status != UNSUITABLE for result in tried[spec])]
    if not suited:
        return found
    deterministic: set[str] = set()
    if seeds > 1:
        walks = list(dict.fromkeys(result.walk for result in tried[suited[0]]))[:PROBED_WALKS]
        probed = _by_spec(evaluate(suited, share.env, walks=walks, seeds=2, **options).results)
        deterministic = {spec for spec in suited if _is_deterministic(probed[spec])}
    for count in sorted({1, seeds}):
        chosen = [spec for spec in suited if (1 if spec in deterministic else seeds) == count]
        if chosen:
            results = _by_spec(evaluate(chosen, share.env, walks=share.walks, seeds=count, **options).results)
            found |= {spec: Played(spec in deterministic, results[spec]) for spec in chosen}
    return found


def make_bundle(
    spec: str, card: Card, suite: Suite, outing: Outing, *, seeds: int | None = None, with_source: bool = True
) -> Bundle:
    """A bundle of what one localizer answered.

    Args:
        spec: As it was run.
        card: Of its authors.
        suite: That it was run on.
        outing: From `play_suite`.
        seeds: As in `play_suite`.
        with_source: Whether the file travels with it, where the localizer is one file: maintainers can run it then.

    Raises:
        BundleError: It suits no environment at hand, fails on every walk, or is of another division than its card says.
    """
    if not outing.played:
        reasons = [f"{env}: {why}" for env, why in outing.unsuitable.items()]
        raise BundleError(f"{spec} answers no environment of {suite.name} at hand ({'; '.join(reasons) or 'none is'})")
    played = [result for of_env in outing.played.values() for result in of_env.results]
    _check_division(card, played)
    if all(result.status in (FAILED, UNSUITABLE) for result in played):
        why = next(result.failure for result in played if result.status == FAILED)
        raise BundleError(f"{spec} fails on every walk ({last_line(why)}); try `pdrbench check localizer {spec}`")
    first = next(result for result in played if result.status != UNSUITABLE)
    text = card_toml(card)
    source = _source(spec) if with_source else {}
    estimates, records = [], []
    for env, of_env in outing.played.items():
        whole = [coding.whole_numbers(_rounded(result)) for result in of_env.results]
        records.append(_record(env, of_env, whole))
        estimates += whole
    manifest = Manifest(
        suite=suite.name,
        localizer=card.name,
        spec=_portable(spec),
        seeds=suite.seeds if seeds is None else seeds,
        parameters=_mapping(first, "parameters"),
        versions=_mapping(first, "versions"),
        core_sha256=str(first.provenance["core_sha256"]),
        localizer_sha256=str(first.provenance["localizer_sha256"]),
        card_sha256=hashlib.sha256(text).hexdigest(),
        source={name: hashlib.sha256(content).hexdigest() for name, content in source.items()},
        unsuitable=dict(outing.unsuitable),
        absent=outing.absent,
        environments=tuple(records),
    )
    run = Run(
        started_at=min(str(result.provenance["started_at"]) for result in played),
        machine=_mapping(first, "machine"),
        isolation=_distinct(played),
        budget=_mapping(first, "budget"),
        walks={env: tuple(walk_run(result) for result in of_env.results) for env, of_env in outing.played.items()},
    )
    return Bundle(manifest=manifest, run=run, card=card, estimates=tuple(estimates), source=source)


def save_bundle(bundle: Bundle, path: Path) -> Path:
    """Writes a bundle whole or not at all; raises `ResultError` where it cannot be written."""
    from pdrbench.evaluation.store import write_whole

    write_whole(path, write_bundle(bundle))
    return path


def is_at_hand(env: str) -> bool:
    """Whether the recorded data of an environment is at hand; generated walks always are."""
    dataset = make_task(env).dataset
    try:
        if dataset is not None:
            find(dataset)
    except DatasetError:
        return False
    return True


def _by_spec(results: Sequence[Result]) -> dict[str, tuple[Result, ...]]:
    found: dict[str, list[Result]] = {}
    for result in results:
        found.setdefault(result.localizer, []).append(result)
    return {spec: tuple(of_spec) for spec, of_spec in found.items()}


def _is_deterministic(results: Sequence[Result]) -> bool:
    """Whether all seeds of each walk gave the same estimates."""
    digests: dict[str, set[str]] = {}
    for result in results:
        digests.setdefault(result.walk, set()).add(coding.digest(coding.whole_numbers(result.estimates)))
    return all(len(of_walk) == 1 for of_walk in digests.values())


def _rounded(result: Result) -> Estimates:
    return coding.rounded(result.estimates, make_task(result.env).period_s)


def _record(env: str, played: Played, whole: Sequence[coding.Whole]) -> EnvironmentRecord:
    task = make_task(env)
    return EnvironmentRecord(
        env=env,
        split="test",
        period_s=task.period_s,
        task_sha256=task.sha256,
        deterministic=played.deterministic,
        walks=tuple(walk_record(result, columns) for result, columns in zip(played.results, whole, strict=True)),
    )


def _check_division(card: Card, results: Sequence[Result]) -> None:
    division = OFFLINE if any(result.division == OFFLINE for result in results) else ONLINE
    if division == OFFLINE != card.division:
        raise BundleError(f"{card.name} revises its past: its card has to say {OFFLINE!r} as its division")


def _mapping(result: Result, name: str) -> dict[str, Any]:
    found = result.provenance.get(name)
    return dict(found) if isinstance(found, Mapping) else {}


def _distinct(results: Sequence[Result]) -> tuple[dict[str, Any], ...]:
    """Each way in which walks were isolated, once."""
    ways = {msgspec.json.encode(_mapping(result, "isolation"), order="deterministic") for result in results}
    return tuple(way for way in map(msgspec.json.decode, sorted(ways)) if way)


def _source(spec: str) -> dict[str, bytes]:
    """The file behind `path/to/file.py:Class`."""
    path = Path(spec.partition(":")[0])
    if path.suffix != ".py":
        return {}
    try:
        return {path.name: path.read_bytes()}
    except OSError as error:
        raise PdrbenchError(f"cannot read {path}: {error.strerror}") from error


def _portable(spec: str) -> str:
    """A specification without the folders of the one who packed it."""
    place, colon, attribute = spec.partition(":")
    return f"{Path(place).name}{colon}{attribute}" if place.endswith(".py") else spec
