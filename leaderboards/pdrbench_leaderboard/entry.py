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

from pdrbench.errors import BundleError
from pdrbench.evaluation.store import write_whole
from pdrbench.registry import ENVIRONMENTS_GROUP, current_id, make_task
from pdrbench.result import OFFLINE, ONLINE, Result
from pdrbench_leaderboard import coding
from pdrbench_leaderboard.card import CARD_FILE, Card, card_toml, read_card
from pdrbench_leaderboard.manifest import (
    MAX_TOTAL_ROWS,
    EnvironmentRecord,
    Manifest,
    RunRecord,
    WalkRecord,
    WalkRun,
    check_version,
)
from pdrbench_leaderboard.schema import Sha256, read_json, read_limited, write_json
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


class Submission(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The content of `submission.json`."""

    manifest: Manifest  # what was run, with one environment
    run: RunRecord  # when, where and how long
    content_sha256: Sha256  # digest of the bundle that the entry was unpacked from


@dataclass(frozen=True, slots=True)
class Entry:
    """One localizer on one environment."""

    card: Card  # what its authors say of it
    submission: Submission  # everything else that is known of it
    # Estimates as they were rounded; step times in rising order, to 4.4 %. Those of maintainers where they ran it again
    results: tuple[Result, ...]
    sent: tuple[Result, ...]  # as they were packed
    verification: Verification | None = None  # what a maintainer found and signed; None before that
    signed: bytes = b""  # the file with that signature

    @property
    def record(self) -> EnvironmentRecord:
        """What the manifest says of the environment."""
        return self.submission.manifest.environments[0]

    @property
    def env(self) -> str:
        """Environment id."""
        return self.record.env

    @property
    def localizer(self) -> str:
        """Id on the leaderboards."""
        return self.submission.manifest.localizer

    @property
    def suite(self) -> str:
        """Name of the suite."""
        return self.submission.manifest.suite

    @property
    def tier(self) -> str:
        """ "self-reported", or what a maintainer has signed: "spot-checked", "reproduced" or "verified"."""
        return SELF_REPORTED if self.verification is None else self.verification.tier

    @property
    def sha256(self) -> str:
        """Digest of what was run and what came of it; the name of the environment may change later and is left out."""
        record = msgspec.structs.replace(self.record, env="-")
        manifest = msgspec.structs.replace(self.submission.manifest, environments=(record,))
        return hashlib.sha256(write_json(manifest)).hexdigest()

    @property
    def isolation_modes(self) -> list[str]:
        """How its walks were isolated, as in "landlock+namespaces+seccomp"; "unknown" where a run does not say."""
        ways = self.submission.run.isolation if self.verification is None else self.verification.isolation
        return sorted({str(way.get("mode") or "unknown") for way in ways} or {"unknown"})

    @property
    def machine(self) -> Mapping[str, Any]:
        """The machine on which the results came about."""
        return self.submission.run.machine if self.verification is None else self.verification.machine

    @property
    def division(self) -> str:
        """ "offline" where any walk was revised."""
        return OFFLINE if any(walk.division == OFFLINE for walk in self.record.walks) else ONLINE


def make_entry(
    submission: Submission, card: Card, estimates: Sequence[coding.Whole], what: str = SUBMISSION_FILE
) -> Entry:
    """An entry from its parts, ready to be scored.

    Args:
        submission: With one environment in its manifest.
        card: Its card.
        estimates: Whole numbers of each walk, in the order of the manifest.
        what: For errors.

    Raises:
        BundleError: The parts do not belong together, or are on other walks than the present ones.
        UnknownNameError: Its environment is not registered.
    """
    if len(submission.manifest.environments) != 1:
        raise BundleError(
            f"{what}: an entry is of one environment, this one of {len(submission.manifest.environments)}"
        )
    submission = _with_current_id(submission)
    manifest, run = submission.manifest, submission.run
    record = manifest.environments[0]
    runs = run.walks.get(record.env, ())
    if not len(record.walks) == len(runs) == len(estimates):
        raise BundleError(
            f"{what}: {len(record.walks)} walks are listed, {len(runs)} timed, {len(estimates)} have estimates"
        )
    if card.name != manifest.localizer:
        raise BundleError(f"{what}: is of {manifest.localizer!r}, its card of {card.name!r}")
    make_task(record.env)  # raises where there is none
    looks = [look for env, look in run.looks.items() if current_id(ENVIRONMENTS_GROUP, env) == record.env]
    provenance = {
        "core_sha256": manifest.core_sha256,
        "localizer_sha256": manifest.localizer_sha256,
        "parameters": manifest.parameters,
        "versions": manifest.versions,
        "machine": run.machine,
        "started_at": run.started_at,
        **({"isolation": run.isolation[0]} if run.isolation else {}),
        **({"budget": run.budget} if run.budget else {}),
        **({"look": {"env": record.env, **msgspec.structs.asdict(looks[0])}} if looks else {}),
    }
    results = results_of(record, record.walks, runs, estimates, manifest.localizer, provenance)
    return Entry(card, submission, results, results)


def results_of(
    record: EnvironmentRecord,
    walks: Sequence[WalkRecord],
    runs: Sequence[WalkRun],
    estimates: Sequence[coding.Whole],
    localizer: str,
    provenance: Mapping[str, object],
) -> tuple[Result, ...]:
    """Results as they can be scored, from what is kept of them."""
    return tuple(
        Result(
            env=record.env,
            split=record.split,
            walk=walk.walk,
            localizer=localizer,
            seed=walk.seed,
            estimates=coding.from_whole_numbers(whole, record.period_s),
            step_s=coding.times(timed.step_times, walk.rows),
            reset_s=math.nan if timed.reset_s is None else timed.reset_s,
            status=walk.status,
            failure=timed.failure,
            missing=walk.missing,
            provenance=provenance if timed.peak_mb is None else {**provenance, "peak_mb": timed.peak_mb},
            division=walk.division,
            revise_s=math.nan if timed.revise_s is None else timed.revise_s,
        )
        for walk, timed, whole in zip(walks, runs, estimates, strict=True)
    )


def _with_current_id(submission: Submission) -> Submission:
    """The submission with the id that its environment has now."""
    manifest, run = submission.manifest, submission.run
    record = manifest.environments[0]
    env = current_id(ENVIRONMENTS_GROUP, record.env)
    if env == record.env:
        return submission
    manifest = msgspec.structs.replace(manifest, environments=(msgspec.structs.replace(record, env=env),))
    run = msgspec.structs.replace(run, walks={current_id(ENVIRONMENTS_GROUP, k): v for k, v in run.walks.items()})
    return msgspec.structs.replace(submission, manifest=manifest, run=run)


def read_entry(folder: Path, keys: Keys | None = None) -> Entry:
    """An entry of a leaderboard, its digests and its signature checked.

    Args:
        folder: `<env>/<localizer>` of a folder of leaderboards.
        keys: Of maintainers; None: those of the folder of leaderboards.

    Raises:
        BundleError: It is not what `write_entry` writes, or was changed since, or is on other walks; one of the errors
            of `signing` and `verification` where its tier is not what a maintainer has signed.
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
    submission = read_json(content, Submission, str(folder / SUBMISSION_FILE))
    content = read_limited(folder / CARD_FILE, MAX_FILE_BYTES)
    if hashlib.sha256(content).hexdigest() != submission.manifest.card_sha256:
        raise BundleError(f"{folder / CARD_FILE} is not the card that was packed")
    card = read_card(content, str(folder / CARD_FILE))
    walks = [walk for record in submission.manifest.environments for walk in record.walks]
    estimates = decode_walks(read_limited(folder / ESTIMATES_FILE, MAX_FILE_BYTES), walks, str(folder / ESTIMATES_FILE))
    entry = make_entry(submission, card, estimates, str(folder))
    if (entry.env, entry.localizer) != (folder.parent.name, folder.name):
        raise BundleError(f"{folder} holds {entry.localizer} on {entry.env}: an entry lies in <env>/<localizer>/")
    return entry


def _with_verification(entry: Entry, folder: Path, keys: Keys) -> Entry:
    """The entry with what a maintainer has signed: tier, times, and the estimates of the second run."""
    what = str(folder / VERIFICATION_FILE)
    signed = read_limited(folder / VERIFICATION_FILE, MAX_FILE_BYTES)
    found = read_verification(signed, keys, what)
    rerun = read_limited(folder / RERUN_FILE, MAX_FILE_BYTES) if (folder / RERUN_FILE).is_file() else None
    if (rerun is None) != (not found.walks):
        raise BundleError(f"{what} is of a second run with other estimates or without, and {RERUN_FILE} is not so")
    wholes = decode_walks(rerun, found.walks, str(folder / RERUN_FILE)) if rerun is not None else ()
    held_out = folder / HELD_OUT_FILE
    if held_out.is_file():
        digest = hashlib.sha256(read_limited(held_out, MAX_FILE_BYTES)).hexdigest()
        if found.held_out is None or digest != found.held_out.estimates_sha256:
            raise BundleError(f"{held_out} is not what came of the held-out walks")
    return verified_entry(entry, found, wholes, signed, what)


def verified_entry(
    entry: Entry, found: Verification, rerun: Sequence[coding.Whole], signed: bytes, what: str = VERIFICATION_FILE
) -> Entry:
    """An entry with the record that a maintainer has signed.

    Args:
        entry: As it was sent.
        found: The record.
        rerun: Estimates of its walks; none where they are those that were sent.
        signed: The file that it was read from.
        what: For errors.

    Raises:
        OtherEntryError: The record is of another entry.
        BundleError: Its walks are not those of the entry.
    """
    check_belongs(found, (entry.suite, entry.env, entry.localizer, entry.sha256), what)
    if found.tier == SPOT_CHECKED:
        return replace(entry, verification=found, signed=signed)
    walks = found.walks or entry.record.walks
    if [(walk.walk, walk.seed) for walk in walks] != [(walk.walk, walk.seed) for walk in entry.record.walks]:
        raise BundleError(f"{what}: the second run is of other walks than those that were sent")
    if len(found.runs) != len(walks):
        raise BundleError(f"{what}: {len(walks)} walks are listed, {len(found.runs)} timed")
    estimates = rerun if found.walks else [coding.whole_numbers(result.estimates) for result in entry.sent]
    known = {
        "core_sha256": found.core_sha256,
        "localizer_sha256": found.localizer_sha256,
        "versions": found.versions,
        "machine": found.machine,
        "started_at": found.date.isoformat(),
        **({"isolation": found.isolation[0]} if found.isolation else {}),
    }
    provenance = {**entry.sent[0].provenance, **known}
    provenance.pop("peak_mb", None)
    results = results_of(entry.record, walks, found.runs, estimates, entry.localizer, provenance)
    return replace(entry, results=results, verification=found, signed=signed)


def decode_walks(content: bytes, walks: Sequence[WalkRecord], what: str) -> list[coding.Whole]:
    """Estimates of some walks, one block after the other; raises `BundleError` where they are not those listed."""
    if sum(walk.rows for walk in walks) > MAX_TOTAL_ROWS:
        raise BundleError(f"{what} holds more than {MAX_TOTAL_ROWS} estimates")
    found, begin = [], 0
    for walk in walks:
        whole, begin = coding.decode(content, what, begin)
        if whole.shape[1] != walk.rows or coding.digest(whole) != walk.sha256:
            raise BundleError(f"{what}: the estimates of walk {walk.walk} with seed {walk.seed} are not those packed")
        found.append(whole)
    if begin != len(content):
        raise BundleError(f"{what} holds more than the {len(walks)} walks that are listed")
    return found


def write_entry(root: Path, entry: Entry) -> Path:
    """Writes an entry below `root`, in place of the one of the same localizer; its folder.

    Raises:
        ResultError: It cannot be written.
    """
    folder = root / entry.env / entry.localizer
    folder.mkdir(parents=True, exist_ok=True)
    for name in (VERIFICATION_FILE, RERUN_FILE, HELD_OUT_FILE):  # of what lay here before
        (folder / name).unlink(missing_ok=True)
    write_whole(folder / ESTIMATES_FILE, _blocks(entry.sent))
    write_whole(folder / CARD_FILE, card_toml(entry.card))
    write_whole(folder / SUBMISSION_FILE, write_json(entry.submission))
    if entry.verification is not None:
        if entry.verification.walks:
            write_whole(folder / RERUN_FILE, _blocks(entry.results))
        write_whole(folder / VERIFICATION_FILE, entry.signed)
    return folder


def _blocks(results: Sequence[Result]) -> bytes:
    return b"".join(coding.encode(coding.whole_numbers(result.estimates)) for result in results)


def list_entries(root: Path) -> list[Path]:
    """Folders of entries below `root`, by environment and localizer; those without a `submission.json` too."""
    return sorted(path for path in root.glob("*/*") if path.is_dir() and not path.name.startswith("."))


def walk_record(result: Result, whole: coding.Whole) -> WalkRecord:
    """What a manifest says of a result."""
    return WalkRecord(
        walk=result.walk,
        seed=result.seed,
        status=result.status,  # type: ignore[arg-type]
        division=result.division,  # type: ignore[arg-type]
        rows=whole.shape[1],
        sha256=coding.digest(whole),
        missing=dict(sorted(result.missing.items())),
    )


def walk_run(result: Result) -> WalkRun:
    """What differs from run to run of a result."""
    peak_mb, child = result.provenance.get("peak_mb"), result.provenance.get("child")
    cpu_s = child.get("cpu_s") if isinstance(child, Mapping) else None
    return WalkRun(
        reset_s=_rounded(result.reset_s),
        revise_s=_rounded(result.revise_s),
        step_times=coding.time_counts(np.asarray(result.step_s)),
        peak_mb=round(peak_mb, 1) if isinstance(peak_mb, (int, float)) else None,
        cpu_s=_rounded(cpu_s) if isinstance(cpu_s, (int, float)) else None,
        failure=last_line(result.failure),
    )


def last_line(text: str) -> str:
    """What happened, without the traceback, which names folders of the machine on which it was packed."""
    return (text.strip().splitlines() or [""])[-1][:MAX_REASON_CHARACTERS]


def _rounded(value_s: float) -> float | None:
    return float(f"{value_s:.3g}") if math.isfinite(value_s) else None
