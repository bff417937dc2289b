"""One row of a leaderboard: `leaderboards/<env>/<localizer>/` with `submission.json`, `card.toml`, `estimates.bin`.

Where a maintainer ran it again, `verification.json` says so under a signature, and `rerun.bin` holds what came of it.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.errors import BundleError, ResultError
from pdrbench.evaluation import answers
from pdrbench.evaluation.store import write_whole
from pdrbench.registry import make_task
from pdrbench.result import OFFLINE, ONLINE, Result
from pdrbench_leaderboard.card import CARD_FILE, Card, card_toml, read_card
from pdrbench_leaderboard.manifest import MAX_TOTAL_ROWS, EnvironmentRecord, Manifest, WalkRecord, check_version
from pdrbench_leaderboard.schema import read_json, read_limited, write_json
from pdrbench_leaderboard.signing import Keys, MissingSignatureError, read_keys
from pdrbench_leaderboard.verification import (
    HELD_OUT_FILE,
    RERUN_FILE,
    SELF_REPORTED,
    SPOT_CHECKED,
    VERIFICATION_FILE,
    Verification,
    check_belongs,
    read_verification,
)

SUBMISSION_FILE: Final = "submission.json"
ESTIMATES_FILE: Final = "estimates.bin"
SENT: Final = (SUBMISSION_FILE, CARD_FILE, ESTIMATES_FILE)
FILES: Final = frozenset((*SENT, VERIFICATION_FILE, RERUN_FILE, HELD_OUT_FILE))
MAX_FILE_BYTES: Final = 64_000_000
MAX_REASON_CHARACTERS: Final = 400


@dataclass(frozen=True, slots=True)
class Entry:
    """A submission on one environment, ready to be scored."""

    card: Card  # what its authors say of it
    manifest: Manifest  # what was run, with one environment
    estimates: bytes  # of its walks, as they were sent
    sent: tuple[Result, ...]  # what its authors ran, in the order of the manifest
    # What its row shows: that of a maintainer's second run where there was one, as `sent` otherwise
    results: tuple[Result, ...]
    verification: Verification | None = None  # what maintainers found when running it again
    signed: bytes = b""  # the file that this was read from
    rerun: bytes = b""  # estimates of the second run

    @property
    def record(self) -> EnvironmentRecord:
        """Its walks."""
        return self.manifest.environments[0]

    @property
    def env(self) -> str:
        """Id of the environment."""
        return self.record.env

    @property
    def localizer(self) -> str:
        """Id on the leaderboards."""
        return self.manifest.localizer

    @property
    def suite(self) -> str:
        """Name of the suite."""
        return self.manifest.suite

    @property
    def tier(self) -> str:
        """ "self-reported", or what a maintainer has signed: "spot-checked", "reproduced" or "verified"."""
        return SELF_REPORTED if self.verification is None else self.verification.tier

    @property
    def sha256(self) -> str:
        """Digest of what was sent: of the manifest, which holds those of card and estimates."""
        return hashlib.sha256(write_json(self.manifest)).hexdigest()

    @property
    def isolation_modes(self) -> list[str]:
        """How its walks were isolated, as in "landlock+namespaces+seccomp"; "unknown" where a run does not say."""
        ways = self.manifest.isolation if self.verification is None else self.verification.isolation
        return sorted({str(way.get("mode") or "unknown") for way in ways} or {"unknown"})

    @property
    def machine(self) -> Mapping[str, Any]:
        """The machine on which the results came about."""
        return self.manifest.machine if self.verification is None else self.verification.machine

    @property
    def division(self) -> str:
        """ "offline" where any walk was revised."""
        return OFFLINE if any(walk.division == OFFLINE for walk in self.record.walks) else ONLINE


def make_entry(manifest: Manifest, card: Card, estimates: bytes, what: str = SUBMISSION_FILE) -> Entry:
    """An entry from its parts, ready to be scored.

    Args:
        manifest: With one environment.
        card: Its card.
        estimates: Of its walks, one block after the other.
        what: For errors.

    Raises:
        BundleError: The parts do not belong together.
        UnknownNameError: Its environment is not registered.
    """
    if len(manifest.environments) != 1:
        raise BundleError(f"{what}: an entry is of one environment, this one of {len(manifest.environments)}")
    record = manifest.environments[0]
    if card.name != manifest.localizer:
        raise BundleError(f"{what}: is of {manifest.localizer!r}, its card of {card.name!r}")
    make_task(record.env)
    _check_digest(estimates, record.estimates_sha256, what)
    known = {"versions": manifest.versions, "machine": manifest.machine, "started_at": manifest.started_at}
    provenance = known | _first(isolation=manifest.isolation) | ({"budget": manifest.budget} if manifest.budget else {})
    results = read_results(estimates, record, record.walks, manifest.localizer, provenance, what)
    return Entry(card, manifest, estimates, results, results)


def read_results(
    content: bytes,
    record: EnvironmentRecord,
    walks: Sequence[WalkRecord],
    localizer: str,
    provenance: Mapping[str, object],
    what: str,
) -> tuple[Result, ...]:
    """Results as they can be scored, from what is kept of them.

    Args:
        content: Estimates of the walks, one block after the other.
        record: Their environment.
        walks: What else is kept of each.
        localizer: Its id on the leaderboards.
        provenance: Of all of them.
        what: For errors.

    Raises:
        BundleError: The estimates are not those of these walks.
    """
    if sum(walk.rows for walk in walks) > MAX_TOTAL_ROWS:
        raise BundleError(f"{what} holds more than {MAX_TOTAL_ROWS} estimates")
    found, begin = [], 0
    for walk in walks:
        try:
            whole, begin = answers.decode(content, what, begin)
        except ResultError as error:
            raise BundleError(str(error)) from None
        if whole.shape[1] != walk.rows:
            raise BundleError(f"{what}: walk {walk.walk} has {whole.shape[1]} estimates, {walk.rows} are listed")
        found.append(
            Result(
                env=record.env,
                split="test",
                walk=walk.walk,
                localizer=localizer,
                seed=walk.seed,
                estimates=answers.from_whole_numbers(whole, np.arange(walk.rows, dtype=np.float64) * record.period_s),
                step_s=answers.times(walk.step_times, walk.rows),
                reset_s=math.nan if walk.reset_s is None else walk.reset_s,
                status=walk.status,
                failure=walk.failure,
                missing=walk.missing,
                provenance=provenance if walk.peak_mb is None else {**provenance, "peak_mb": walk.peak_mb},
                division=walk.division,
                revise_s=math.nan if walk.revise_s is None else walk.revise_s,
            )
        )
    if begin != len(content):
        raise BundleError(f"{what} holds more than the {len(walks)} walks that are listed")
    return tuple(found)


def read_entry(folder: Path, keys: Keys | None = None) -> Entry:
    """An entry of a leaderboard, its digests and its signature checked.

    Args:
        folder: `<env>/<localizer>` of a folder of leaderboards.
        keys: Of maintainers; None: those of the folder of leaderboards.

    Raises:
        BundleError: It is not what `write_entry` writes, or was changed since; one of the errors of `signing` and
            `verification` where its tier is not what a maintainer has signed.
        UnknownNameError: Its environment is not registered.
    """
    folder = Path(os.path.normpath(folder.absolute()))
    entry = read_sent(folder)
    if not (folder / VERIFICATION_FILE).is_file():
        if (folder / RERUN_FILE).exists() or (folder / HELD_OUT_FILE).exists():
            raise MissingSignatureError(f"{folder} holds what a maintainer ran, and no signed {VERIFICATION_FILE}")
        return entry
    return _with_verification(entry, folder, read_keys(folder.parents[1]) if keys is None else keys)


def read_sent(folder: Path) -> Entry:
    """An entry as it was sent, whatever maintainers have found of it; raises as `read_entry`."""
    folder = Path(os.path.normpath(folder.absolute()))
    if folder.is_symlink() or folder.parent.is_symlink():
        raise BundleError(f"{folder} is a link; an entry is a folder of its own")
    present = folder.iterdir() if folder.is_dir() else ()
    strange = [path for path in present if path.name not in FILES or path.is_symlink() or not path.is_file()]
    if strange:
        raise BundleError(f"{folder} holds {min(strange).name!r}, which is no part of an entry")
    content = read_limited(folder / SUBMISSION_FILE, MAX_FILE_BYTES)
    check_version(content, str(folder / SUBMISSION_FILE))
    manifest = read_json(content, Manifest, str(folder / SUBMISSION_FILE))
    content = read_limited(folder / CARD_FILE, MAX_FILE_BYTES)
    _check_digest(content, manifest.card_sha256, str(folder / CARD_FILE))
    card = read_card(content, str(folder / CARD_FILE))
    estimates = read_limited(folder / ESTIMATES_FILE, MAX_FILE_BYTES)
    entry = make_entry(manifest, card, estimates, str(folder / ESTIMATES_FILE))
    if (entry.env, folder_name(entry.localizer)) != (folder.parent.name, folder.name):
        raise BundleError(f"{folder} holds {entry.localizer} on {entry.env}: an entry lies in <env>/<localizer>/")
    return entry


def _with_verification(entry: Entry, folder: Path, keys: Keys) -> Entry:
    """The entry with what a maintainer has signed: tier, times, and the estimates of the second run."""
    what = str(folder / VERIFICATION_FILE)
    signed = read_limited(folder / VERIFICATION_FILE, MAX_FILE_BYTES)
    found = read_verification(signed, keys, what)
    rerun = read_limited(folder / RERUN_FILE, MAX_FILE_BYTES) if (folder / RERUN_FILE).is_file() else b""
    held_out = folder / HELD_OUT_FILE
    if held_out.is_file():
        if found.held_out is None:
            raise BundleError(f"{held_out} is of no held-out walks that were signed")
        _check_digest(read_limited(held_out, MAX_FILE_BYTES), found.held_out.estimates_sha256, str(held_out))
    return verified_entry(entry, found, rerun, signed, what)


def verified_entry(
    entry: Entry, found: Verification, rerun: bytes, signed: bytes, what: str = VERIFICATION_FILE
) -> Entry:
    """An entry with the record that a maintainer has signed.

    Args:
        entry: As it was sent.
        found: The record.
        rerun: Estimates of the second run; none of a spot check.
        signed: The file that it was read from.
        what: For errors.

    Raises:
        OtherEntryError: The record is of another entry.
        BundleError: Its walks are not those of the entry, or its estimates not those that were signed.
    """
    check_belongs(found, (entry.suite, entry.env, entry.localizer, entry.sha256), what)
    if found.tier == SPOT_CHECKED:
        if rerun:
            raise BundleError(f"{what}: a spot check has no {RERUN_FILE}")
        return replace(entry, verification=found, signed=signed)
    if [(walk.walk, walk.seed) for walk in found.walks] != [(walk.walk, walk.seed) for walk in entry.record.walks]:
        raise BundleError(f"{what}: the second run is of other walks than those that were sent")
    _check_digest(rerun, str(found.estimates_sha256), f"{what}: {RERUN_FILE}")
    known = {"versions": found.versions, "machine": found.machine, "started_at": found.date.isoformat()}
    provenance = known | _first(isolation=found.isolation)
    results = read_results(rerun, entry.record, found.walks, entry.localizer, provenance, what)
    return replace(entry, results=results, verification=found, signed=signed, rerun=rerun)


def write_entry(root: Path, entry: Entry) -> Path:
    """Writes an entry below `root`, in place of the one of the same localizer; its folder.

    Raises:
        ResultError: It cannot be written.
    """
    folder = root / entry.env / folder_name(entry.localizer)
    folder.mkdir(parents=True, exist_ok=True)
    for name in (VERIFICATION_FILE, RERUN_FILE, HELD_OUT_FILE):  # of what lay here before
        (folder / name).unlink(missing_ok=True)
    write_whole(folder / ESTIMATES_FILE, entry.estimates)
    write_whole(folder / CARD_FILE, card_toml(entry.card))
    write_whole(folder / SUBMISSION_FILE, write_json(entry.manifest))
    if entry.verification is not None:
        if entry.rerun:
            write_whole(folder / RERUN_FILE, entry.rerun)
        write_whole(folder / VERIFICATION_FILE, entry.signed)
    return folder


def folder_name(localizer: str) -> str:
    """The folder of an entry: its name, with the mark before settings as every file system takes it.

    >>> folder_name("li2012?map=false")
    'li2012@map=false'
    """
    return localizer.replace("?", "@")


def list_entries(root: Path) -> list[Path]:
    """Folders of entries below `root`, by environment and localizer; those without a `submission.json` too."""
    folders = (path for path in root.glob("*-v*/*") if path.is_dir())  # beside this package
    return sorted(path for path in folders if not path.name.startswith("."))


def encode_results(results: Sequence[Result]) -> bytes:
    """The estimates of some walks, one block after the other."""
    return b"".join(answers.encode(answers.whole_numbers(result.estimates)) for result in results)


def walk_record(result: Result) -> WalkRecord:
    """What is kept of a result beside its answers."""
    peak_mb, child = result.provenance.get("peak_mb"), result.provenance.get("child")
    cpu_s = child.get("cpu_s") if isinstance(child, Mapping) else None
    return WalkRecord(
        walk=result.walk,
        seed=result.seed,
        status=result.status,  # type: ignore[arg-type]
        division=result.division,  # type: ignore[arg-type]
        rows=len(result.estimates),
        missing=dict(sorted(result.missing.items())),
        failure=last_line(result.failure),
        reset_s=_rounded(result.reset_s),
        revise_s=_rounded(result.revise_s),
        step_times=answers.time_counts(np.asarray(result.step_s)),
        peak_mb=round(peak_mb, 1) if isinstance(peak_mb, (int, float)) else None,
        cpu_s=_rounded(cpu_s) if isinstance(cpu_s, (int, float)) else None,
    )


def isolation_ways(results: Sequence[Result]) -> tuple[dict[str, Any], ...]:
    """Each way in which results were isolated, once."""
    found = {msgspec.json.encode(result.provenance.get("isolation") or {}, order="deterministic") for result in results}
    return tuple(way for way in map(msgspec.json.decode, sorted(found)) if way)


def last_line(text: str) -> str:
    """What happened, without the traceback, which names folders of the machine on which it was packed."""
    return (text.strip().splitlines() or [""])[-1][:MAX_REASON_CHARACTERS]


def _check_digest(content: bytes, sha256: str, what: str) -> None:
    if hashlib.sha256(content).hexdigest() != sha256:
        raise BundleError(f"{what} is not the one that was packed: its digest is another")


def _first(**ways: Sequence[object]) -> dict[str, object]:
    """The first of each, where there is one."""
    return {name: of[0] for name, of in ways.items() if of}


def _rounded(value_s: float) -> float | None:
    return float(f"{value_s:.3g}") if math.isfinite(value_s) else None
