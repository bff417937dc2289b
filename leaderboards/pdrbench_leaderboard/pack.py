"""`submit pack`: runs localizers on a suite and makes a bundle of what each of them answered."""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import itertools
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.datasets import is_available
from pdrbench.errors import BundleError, PdrbenchError
from pdrbench.evaluation import evaluate
from pdrbench.evaluation.protocol import PROBED_WALKS, TRIED_WALKS
from pdrbench.evaluation.randomness import check_nonce, new_nonce
from pdrbench.evaluation.store import write_whole
from pdrbench.process.budget import SuiteBudget
from pdrbench.registry import make_task
from pdrbench.result import FAILED, ONLINE, UNSUITABLE, Result, of_division
from pdrbench.settings import split_name, with_settings_of
from pdrbench_leaderboard.bundle import Bundle, write_bundle
from pdrbench_leaderboard.card import Card, card_toml
from pdrbench_leaderboard.entry import encode_results, isolation_ways, last_line, walk_record
from pdrbench_leaderboard.folder_archive import ARCHIVE_FILE, pack_folder
from pdrbench_leaderboard.folders import check_packable, folder_of
from pdrbench_leaderboard.manifest import SCHEMA, EnvironmentRecord, Manifest
from pdrbench_leaderboard.suites import Suite, SuiteEnvironment

SECOND_NONCE_FILE: Final = "second_nonce.txt"  # never published
NONCE_FILE: Final = "nonce.txt"  # in a folder of results: what is continued has the nonce that it was begun with


@dataclass(frozen=True, slots=True)
class SuiteRun:
    """What a localizer answered to a suite."""

    nonce: str = ""  # that the randomness of all walks depended on
    # By environment, in the order of walks and seeds
    results: dict[str, tuple[Result, ...]] = field(default_factory=dict)
    # Environments where two seeds gave the same bytes, so that one was run
    deterministic: set[str] = field(default_factory=set)
    unsuitable: dict[str, str] = field(default_factory=dict)  # why it declined, by environment
    absent: list[str] = field(default_factory=list)  # environments whose recorded data is not available


def play_suite(
    specs: Sequence[str],
    suite: Suite,
    *,
    results: Path | None = None,
    seeds: int | None = None,
    envs: Sequence[str] = (),
    nonce: str = "",
    **options: Any,
) -> dict[str, SuiteRun]:
    """Runs localizers on the walks of a suite; those that draw random numbers with every seed.

    Args:
        specs: As for `evaluate`.
        suite: Of `suites()`.
        results: Folder that keeps every walk, so that a run that was stopped goes on.
        seeds: Instead of those of the suite.
        envs: Only these environments of the suite; all where empty.
        nonce: As for `evaluate`.
        options: Of `evaluate`: jobs, isolation, budget, progress.

    Raises:
        PdrbenchError: As `evaluate`.
    """
    seeds = suite.seeds if seeds is None else seeds
    for spec in specs:
        check_packable(spec)
    runs = {spec: SuiteRun(nonce) for spec in specs}
    with suite_budget(results, suite.name) as budget:
        common = {"out": results, "split": "test", "nonce": nonce, **options}
        common |= {"suite_budget": budget}
        for listed in suite.environments:
            if envs and listed.env not in envs:
                continue
            if has_data(listed.env):
                _play_environment(runs, listed, seeds, common)
            else:
                for run in runs.values():
                    run.absent.append(listed.env)
    return runs


@contextlib.contextmanager
def suite_budget(results: Path | None, name: str) -> Iterator[SuiteBudget]:
    """The time that each localizer has for a suite, booked beside the folder that keeps every walk.

    Args:
        results: That folder; where there is none, what was booked is forgotten at the end.
        name: Of the suite, and of what is done with it.
    """
    if results is not None:
        yield SuiteBudget(results.absolute().with_name(f"{results.name}.time") / name)
        return
    with tempfile.TemporaryDirectory(prefix="pdrbench-time-") as folder:
        yield SuiteBudget(Path(folder))


def _play_environment(
    runs: Mapping[str, SuiteRun], listed: SuiteEnvironment, seeds: int, options: Mapping[str, Any]
) -> None:
    """Adds what each localizer answered, or why it declined.

    All of them are run together: a recording is made once for all of them.
    """
    few = min(TRIED_WALKS, listed.walks)
    tried = _by_spec(evaluate(list(runs), listed.env, walks=few, seeds=1, **options).results)
    suited = [spec for spec in runs if any(result.status != UNSUITABLE for result in tried[spec])]
    for spec in runs.keys() - set(suited):
        runs[spec].unsuitable[listed.env] = last_line(tried[spec][0].failure)
    if not suited:
        return
    alike = suited if seeds > 1 else []
    first = list(dict.fromkeys(result.walk for result in tried[suited[0]]))[:PROBED_WALKS]
    for walks in (first, listed.walks):  # one that draws on a later walk only draws, too
        if alike:
            probed = _by_spec(evaluate(alike, listed.env, walks=walks, seeds=2, **options).results)
            alike = [spec for spec in alike if _is_deterministic(probed[spec])]
    for spec in alike:
        runs[spec].deterministic.add(listed.env)
        runs[spec].results[listed.env] = tuple(result for result in probed[spec] if result.seed == 0)
    drawing = [spec for spec in suited if spec not in alike]
    if drawing:
        results = _by_spec(evaluate(drawing, listed.env, walks=listed.walks, seeds=seeds, **options).results)
        for spec in drawing:
            runs[spec].results[listed.env] = results[spec]


def kept_nonce(results: Path | None, nonce: str | None, name: str = NONCE_FILE) -> str:
    """The nonce of a run: that which was asked for, that which results in a folder began with, or a new one.

    Args:
        results: Folder of results; None where none are kept.
        nonce: That which was asked for.
        name: Of the file that keeps it there. That of a run which was packed is published, another one is not.
    """
    path = None if results is None else results / name
    if nonce is None and path is not None and path.is_file():
        return check_nonce(path.read_text(encoding="ascii", errors="replace").strip())
    nonce = new_nonce() if nonce is None else check_nonce(nonce)
    if path is not None:
        write_whole(path, f"{nonce}\n".encode())
    return nonce


def second_nonce(results: Path | None, *words: str) -> str:
    """The nonce of a second run. It is published, and the one that it is made from is not: no other follows from it.

    Args:
        results: Folder of results; None where none are kept.
        words: What is run.
    """
    kept = kept_nonce(results, None, SECOND_NONCE_FILE)
    return hmac.new(kept.encode(), "\n".join(words).encode(), hashlib.sha256).hexdigest()[: len(kept)]


def make_bundle(
    spec: str, card: Card, suite: Suite, suite_run: SuiteRun, *, seeds: int | None = None, with_source: bool = True
) -> Bundle:
    """A bundle of what one localizer answered.

    Args:
        spec: As it was run.
        card: Of its authors.
        suite: That it was run on.
        suite_run: From `play_suite`.
        seeds: As in `play_suite`.
        with_source: Whether the file travels with it, where the localizer is one file: maintainers can run it then.

    Raises:
        BundleError: It suits no environment, fails on every walk, or is of another division than its card says.
    """
    if not suite_run.results:
        reasons = [f"{env}: {why}" for env, why in suite_run.unsuitable.items()]
        raise BundleError(
            f"{spec} answers no available environment of {suite.name} ({'; '.join(reasons) or 'none is'})"
        )
    by_env = {env: of_division(results, card.division) for env, results in suite_run.results.items()}
    by_env = {env: results for env, results in by_env.items() if results}
    if not by_env:
        raise BundleError(f"{card.name} does not revise its past: its card has to say {ONLINE!r} as its division")
    played = list(itertools.chain.from_iterable(by_env.values()))
    if all(result.status in (FAILED, UNSUITABLE) for result in played):
        why = next(result.failure for result in played if result.status == FAILED)
        raise BundleError(f"{spec} fails on every walk ({last_line(why)}); try `pdrbench check localizer {spec}`")
    first = next(result for result in played if result.status != UNSUITABLE)
    text = card_toml(card)
    source = _source(spec) if with_source else {}
    estimates, records = {}, []
    for env, results in by_env.items():
        period_s = make_task(env).period_s
        _check_times(results, period_s)
        estimates[env] = encode_results(results)
        records.append(
            EnvironmentRecord(
                env=env,
                period_s=period_s,
                deterministic=env in suite_run.deterministic,
                estimates_sha256=hashlib.sha256(estimates[env]).hexdigest(),
                walks=tuple(map(walk_record, results)),
            )
        )
    manifest = Manifest(
        schema=SCHEMA,
        suite=suite.name,
        localizer=card.name,
        spec=_portable(spec),
        seeds=suite.seeds if seeds is None else seeds,
        nonce=suite_run.nonce,
        versions=_mapping(first, "versions"),
        card_sha256=hashlib.sha256(text).hexdigest(),
        source={name: hashlib.sha256(content).hexdigest() for name, content in source.items()},
        unsuitable=dict(suite_run.unsuitable),
        absent=tuple(suite_run.absent),
        environments=tuple(records),
        started_at=min(str(result.provenance["started_at"]) for result in played),
        machine=_mapping(first, "machine"),
        isolation=isolation_ways(played),
        budget=_mapping(first, "budget"),
    )
    return Bundle(manifest=manifest, card=card, estimates=estimates, source=source)


def _check_times(results: Sequence[Result], period_s: float) -> None:
    """Raises `BundleError` where estimates do not answer the observations at 0, `period_s`, 2 `period_s`, ..."""
    for result in results:
        if not np.array_equal(result.estimates.t_s, np.arange(len(result.estimates)) * period_s):
            raise BundleError(f"estimates are not given every {period_s:g} s from 0 s on, so they cannot be packed")


def save_bundle(bundle: Bundle, path: Path) -> Path:
    """Writes a bundle whole or not at all; raises `ResultError` where it cannot be written."""
    write_whole(path, write_bundle(bundle))
    return path


def has_data(env: str) -> bool:
    """Whether the recorded data of an environment is found; generated walks need none."""
    dataset = make_task(env).dataset
    return dataset is None or is_available(dataset)


def _by_spec(results: Sequence[Result]) -> dict[str, tuple[Result, ...]]:
    found: dict[str, list[Result]] = {}
    for result in results:
        found.setdefault(result.localizer, []).append(result)
    return {spec: tuple(of_spec) for spec, of_spec in found.items()}


def _is_deterministic(results: Sequence[Result]) -> bool:
    """Whether all seeds of each walk gave the same estimates."""
    by_walk: dict[str, list[Result]] = {}
    for result in results:
        by_walk.setdefault(result.walk, []).append(result)
    return all(encode_results([one]) == encode_results(of[:1]) for of in by_walk.values() for one in of)


def _mapping(result: Result, name: str) -> dict[str, Any]:
    found = result.provenance.get(name)
    return dict(found) if isinstance(found, Mapping) else {}


def _source(spec: str) -> dict[str, bytes]:
    """The file behind `path/to/file.py:Class`, or the archive of a folder."""
    folder = folder_of(spec)
    if folder is not None:
        return {ARCHIVE_FILE: pack_folder(folder)}
    path = Path(split_name(spec)[0].partition(":")[0])
    if path.suffix != ".py":
        return {}
    try:
        return {path.name: path.read_bytes()}
    except OSError as error:
        raise PdrbenchError(f"cannot read {path}: {error.strerror}") from error


def _portable(spec: str) -> str:
    """A specification without the folders of the machine on which it was packed."""
    if folder_of(spec) is not None:
        return with_settings_of(spec, ARCHIVE_FILE)
    place, colon, attribute = spec.partition(":")
    return f"{Path(place).name}{colon}{attribute}" if place.endswith(".py") else spec
