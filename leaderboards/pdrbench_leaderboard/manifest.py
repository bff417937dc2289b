"""What a submission says of itself: what was run, when, where, how long each walk took, and what it came to."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import msgspec

from pdrbench.errors import BundleError
from pdrbench_leaderboard.schema import Count, EntryName, Line, Name, Nonce, Passage, Remark, Sha256
from pdrbench_leaderboard.suites import successor

SCHEMA: Final = 3  # version of the format of bundles and entries
MAX_SEEDS: Final = 100
MAX_TOTAL_ROWS: Final = 8_000_000  # 64 MB a column

Status = Literal["complete", "failed", "unsuitable"]  # of `pdrbench.result`
Division = Literal["online", "offline"]
Seconds = Annotated[float, msgspec.Meta(ge=0, le=1e9)]
Finite = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]
# See `answers.time_counts`.
TimeCounts = Annotated[str, msgspec.Meta(pattern=r"^([0-9]{1,3}:[0-9]{1,7}( |\Z))*\Z", max_length=5000)]


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Part of a file that strangers send."""


class WalkRecord(Record, frozen=True, kw_only=True):
    """One walk with one seed: all that is kept of a `Result` beside its answers."""

    walk: Name
    seed: Annotated[int, msgspec.Meta(ge=0, le=1_000_000)]
    status: Status  # as in `pdrbench.result.Result`
    division: Division  # "offline" where the past was revised
    rows: Annotated[int, msgspec.Meta(ge=0, le=1_000_000)]  # observations that were answered
    # Count by reason of answers that count as missing
    missing: Annotated[dict[Name, Count], msgspec.Meta(max_length=100)] = {}
    failure: Passage = ""  # why it is not complete, in one line
    reset_s: Seconds | None = None  # wall time of `reset`; None where it was not measured
    revise_s: Seconds | None = None  # wall time of `revise`, likewise
    step_times: TimeCounts = ""  # how often steps took how long, see `answers.time_counts`
    peak_mb: Annotated[float, msgspec.Meta(ge=0, le=1e9)] | None = None  # peak memory of the localizer in 10^6 bytes
    cpu_s: Seconds | None = None  # processor time of the localizer, start-up included


# In the order of the split, seeds of a walk side by side
Walks = Annotated[tuple[WalkRecord, ...], msgspec.Meta(max_length=5000)]


class EnvironmentRecord(Record, frozen=True, kw_only=True):
    """The walks of one environment."""

    env: Name
    period_s: Annotated[float, msgspec.Meta(gt=0, le=3600)]  # between observations
    deterministic: bool  # whether two seeds gave the same answers, so that one was kept
    estimates_sha256: Sha256  # of the file of estimates
    walks: Walks


class Manifest(Record, frozen=True, kw_only=True):
    """What was run; that of an entry has one environment."""

    schema: Literal[3]  # version of this format
    suite: Name
    localizer: EntryName  # id on the leaderboards; `name` of the card
    # As it was run: a registered id, `package.module:Class`, or `file.py:Class` for a file in `source`; with settings
    spec: Line
    # Runs of every walk of a localizer that draws random numbers
    seeds: Annotated[int, msgspec.Meta(ge=1, le=MAX_SEEDS)]
    nonce: Nonce  # that its randomness depends on besides seed and walk
    versions: Annotated[dict[Name, Remark], msgspec.Meta(max_length=20)]  # of pdrbench, NumPy, Python
    card_sha256: Sha256  # of `card.toml`
    # Sha256 by name of the files that travel with it
    source: Annotated[dict[Name, Sha256], msgspec.Meta(max_length=20)] = {}
    # Why it declined, by environment of the suite that it has no walks of
    unsuitable: Annotated[dict[Name, Remark], msgspec.Meta(max_length=200)] = {}
    # Environments of the suite whose recorded data was not found
    absent: Annotated[tuple[Name, ...], msgspec.Meta(max_length=200)] = ()
    environments: Annotated[tuple[EnvironmentRecord, ...], msgspec.Meta(max_length=200)]  # with their walks
    started_at: Remark  # first moment of the walks, ISO 8601
    machine: Annotated[dict[Name, Remark | int], msgspec.Meta(max_length=20)]  # processor, cores, system
    # Each way in which walks were isolated
    isolation: Annotated[tuple[dict[str, Any], ...], msgspec.Meta(max_length=50)] = ()
    budget: Annotated[dict[Name, Finite], msgspec.Meta(max_length=20)] = {}  # time that the localizer was given


class OldFormatError(BundleError):
    """A bundle or an entry of another version of the format."""


class _Versioned(msgspec.Struct):
    """What is read of a manifest before its version is known."""

    schema: Any = 1
    spec: Any = None
    suite: Any = None


def check_version(content: bytes, what: str) -> None:
    """Raises `OldFormatError` where a manifest is not of this format."""
    try:
        manifest = msgspec.json.decode(content, type=_Versioned)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return  # whoever reads it says what is wrong
    if manifest.schema != SCHEMA:
        raise OldFormatError(
            f"{what} is of format {str(manifest.schema)[:20]}, and this version reads format {SCHEMA}: pack it again "
            f"with `pdrbench submit pack {str(manifest.spec or 'LOCALIZER')[:200]} "
            f"--suite {successor(str(manifest.suite))}`"
        )
