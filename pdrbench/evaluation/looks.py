"""Looks at the test split of sealed environments: an append-only ledger in the folder of the results.

Each line is one look, as JSON, and holds the sha256 of the line before it: a line that is changed, taken out or put in
breaks every digest after it. A look is one localizer with one code and one set of parameters: to go on with a run that
was interrupted, to play more walks or to repeat it is no second look, for nothing was changed after what was seen.
Held-out walks of a sealed environment count as its test walks do: where they are replays, they are the same walks.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, Final

import msgspec

from pdrbench.errors import PdrbenchError, ResultError
from pdrbench.evaluation import store
from pdrbench.evaluation.walk_job import HIDDEN_SPLITS, WalkJob
from pdrbench.files import lock
from pdrbench.registry import LOCALIZERS_GROUP, entries, make_task

LEDGER: Final = "looks.jsonl"
FIRST: Final = hashlib.sha256(b"").hexdigest()  # what stands in the first line in place of a digest


class Look(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One look.

    Attributes:
        at: When, UTC.
        env: Environment id.
        localizer: As it was named.
        package: Distribution that the localizer belongs to, or the name of its file.
        what_sha256: Of the code of the localizer and its parameters.
        why: The reason that was given.
        previous: Sha256 of the line before.
    """

    at: str
    env: str
    localizer: str
    package: str
    what_sha256: str
    why: str
    previous: str


def read_looks(folder: Path) -> tuple[Look, ...]:
    """The looks that a folder of results holds, oldest first.

    Raises:
        ResultError: A line was changed, taken out or put in; names the first that does not fit.
    """
    path = folder / LEDGER
    try:
        return _parse(path.read_bytes(), path)
    except FileNotFoundError:
        return ()
    except OSError as error:
        raise ResultError(f"cannot read {path}: {error.strerror or error}") from error


def checked_looks(folder: Path) -> tuple[Look, ...]:
    """The same, where the results beside it agree: each holds the digest of a line that must still be there.

    Raises:
        ResultError: As `read_looks`; or a result names a look that is not in the ledger; or a result is torn.
    """
    looks = read_looks(folder)
    lines = {hashlib.sha256(msgspec.json.encode(look)).hexdigest() for look in looks}
    for path in sorted(folder.glob(f"*{store.SUFFIX}")):
        look: Any = store.load(path).provenance.get("look")
        if look and look["ledger"] not in lines:
            raise ResultError(f"{path} is of a look that {folder / LEDGER} does not hold: the ledger was changed")
    return looks


def with_looks(jobs: Sequence[WalkJob], why: str, folder: Path) -> list[WalkJob]:
    """Jobs whose results will say how often their localizer's package has looked; new looks are entered in the ledger.

    Args:
        jobs: On any environments; those that are no look stay as they are.
        why: The reason for a look.
        folder: Holds the ledger.

    Raises:
        PdrbenchError: A look without a reason.
        ResultError: The ledger is damaged or cannot be written.
    """
    sealed = {task for task in {job.task for job in jobs} if make_task(task).sealed}
    looked = {(job.env, job.localizer): job for job in jobs if job.split in HIDDEN_SPLITS and job.task in sealed}
    if not looked:
        return list(jobs)
    if not why.strip():
        raise PdrbenchError(
            f"the test split of {next(iter(looked))[0]} is sealed: develop on val or with --folds 5, and for the final "
            f'score say why you look: --split test --why "..."'
        )
    try:
        with (folder / LEDGER).open("a+b") as ledger:
            lock(ledger)
            notes = _enter(ledger, looked, " ".join(why.split()))
    except OSError as error:
        raise ResultError(f"cannot write {folder / LEDGER}: {error.strerror or error}") from error
    return [
        replace(job, look=notes.get((job.env, job.localizer)) if job.split in HIDDEN_SPLITS else None) for job in jobs
    ]


def look_notes(provenances: Iterable[Any]) -> list[str]:
    """A line for each environment and package that looked, from the provenances of results."""
    counts: dict[tuple[str, str], tuple[int, str]] = {}
    for provenance in provenances:
        if look := provenance.get("look"):
            place = (look["env"], look["package"])
            counts[place] = max(counts.get(place, (0, "")), (look["count"], look["why"]))
    return [
        f"look {count} of {package} at the sealed test split of {env}: {why}"
        for (env, package), (count, why) in counts.items()
    ]


def _parse(content: bytes, path: Path) -> tuple[Look, ...]:
    looks, previous = [], FIRST
    for number, line in enumerate(content.splitlines(), 1):
        try:
            look = msgspec.json.decode(line, type=Look)
        except msgspec.DecodeError as error:
            raise ResultError(f"{path}, line {number}: {error}; the ledger of looks is append-only") from error
        if look.previous != previous:
            raise ResultError(f"{path}, line {number} does not follow from the line before: the ledger was changed")
        previous = hashlib.sha256(line).hexdigest()
        looks.append(look)
    return tuple(looks)


def _enter(
    ledger: IO[bytes], looked: Mapping[tuple[str, str], WalkJob], why: str
) -> dict[tuple[str, str], dict[str, Any]]:
    """Appends new looks; what the results of each environment and localizer say of them."""
    ledger.seek(0)
    content = ledger.read()
    looks = list(_parse(content, Path(ledger.name)))
    added = b"" if content.endswith(b"\n") or not content else b"\n"
    previous = hashlib.sha256(content.splitlines()[-1]).hexdigest() if content else FIRST
    notes = {}
    for (env, localizer), job in looked.items():
        package = _package(localizer)
        what = [job.target.rpartition(":")[2], job.sources["localizer_sha256"], job.parameters]
        what_sha256 = hashlib.sha256(msgspec.json.encode(what, order="deterministic")).hexdigest()
        if all((look.env, look.what_sha256) != (env, what_sha256) for look in looks):
            look = Look(
                at=datetime.now(UTC).isoformat(timespec="seconds"),
                env=env,
                localizer=localizer,
                package=package,
                what_sha256=what_sha256,
                why=why,
                previous=previous,
            )
            line = msgspec.json.encode(look)
            looks.append(look)
            added += line + b"\n"
            previous = hashlib.sha256(line).hexdigest()
        count = sum((look.env, look.package) == (env, package) for look in looks)
        notes[env, localizer] = {"env": env, "package": package, "count": count, "why": why, "ledger": previous}
    ledger.write(added)
    ledger.flush()
    return notes


def _package(localizer: str) -> str:
    """The distribution of a registered localizer, else the name of its file or module."""
    entry = entries(LOCALIZERS_GROUP).get(localizer)
    return entry.package if entry is not None else Path(localizer.partition(":")[0]).name
