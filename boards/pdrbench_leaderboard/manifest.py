"""What a submission says of itself: what was run (`Manifest`), and what differs from run to run (`RunRecord`)."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import msgspec

from pdrbench_leaderboard.schema import Count, Line, Name, Passage, Remark, Sha256

MAX_SEEDS: Final = 100
MAX_TOTAL_ROWS: Final = 8_000_000  # 64 MB a column

Status = Literal["complete", "failed", "unsuitable"]  # of `pdrbench.result`
Division = Literal["online", "offline"]
Tier = Literal["self-reported", "reproduced", "verified"]
SELF_REPORTED: Final = "self-reported"
REPRODUCED: Final = "reproduced"
VERIFIED: Final = "verified"
Seconds = Annotated[float, msgspec.Meta(ge=0, le=1e9)]
Finite = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]
# See `coding.time_counts`.
TimeCounts = Annotated[str, msgspec.Meta(pattern=r"^([0-9]{1,3}:[0-9]{1,7}( |\Z))*\Z", max_length=5000)]


class _Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    pass


class WalkRecord(_Record, frozen=True, kw_only=True):
    """One walk with one seed."""

    walk: Name
    seed: Annotated[int, msgspec.Meta(ge=0, le=1_000_000)]
    status: Status  # as in `pdrbench.result.Result`
    division: Division  # "offline" where the past was revised
    rows: Annotated[int, msgspec.Meta(ge=0, le=1_000_000)]  # observations that were answered
    sha256: Sha256  # digest of the rounded estimates
    # Count by reason of answers that count as missing
    missing: Annotated[dict[Name, Count], msgspec.Meta(max_length=100)] = {}


class EnvironmentRecord(_Record, frozen=True, kw_only=True):
    """The walks of one environment."""

    env: Name
    split: Literal["test"]  # always "test": held-out walks are for verification
    period_s: Annotated[float, msgspec.Meta(gt=0, le=3600)]  # between observations
    task_sha256: Sha256  # `Task.sha256`
    deterministic: bool  # whether two seeds gave the same bytes, so that one was kept
    # In the order of the split, seeds of a walk side by side
    walks: Annotated[tuple[WalkRecord, ...], msgspec.Meta(min_length=1, max_length=5000)]


class Manifest(_Record, frozen=True, kw_only=True):
    """What was run, and digests of what came of it: the same bytes whenever and wherever the same is run."""

    schema: Literal[1] = 1  # version of this format
    suite: Name
    localizer: Name  # id on the leaderboards; `name` of the card
    spec: Line  # as it was run: a registered id, `package.module:Class`, or `file.py:Class` for a file in `source`
    # Runs of every walk of a localizer that draws random numbers
    seeds: Annotated[int, msgspec.Meta(ge=1, le=MAX_SEEDS)]
    parameters: dict[Name, Any] = {}  # keyword arguments of its class
    versions: Annotated[dict[Name, Remark], msgspec.Meta(max_length=20)]  # of pdrbench, NumPy, Python
    core_sha256: Sha256  # digest of the code of pdrbench that makes estimates
    localizer_sha256: Sha256  # digest of the localizer's own code
    card_sha256: Sha256  # of `card.toml`
    # Sha256 by name of the files that travel with it
    source: Annotated[dict[Name, Sha256], msgspec.Meta(max_length=20)] = {}
    # Why it declined, by environment of the suite that it has no walks of
    unsuitable: Annotated[dict[Name, Remark], msgspec.Meta(max_length=200)] = {}
    # Environments of the suite whose recorded data was not found
    absent: Annotated[tuple[Name, ...], msgspec.Meta(max_length=200)] = ()
    environments: Annotated[tuple[EnvironmentRecord, ...], msgspec.Meta(max_length=200)]  # with their walks


class WalkRun(_Record, frozen=True, kw_only=True):
    """What differs from run to run of a walk."""

    reset_s: Seconds | None = None  # wall time of `reset`; None where it was not measured
    revise_s: Seconds | None = None  # wall time of `revise`, likewise
    step_times: TimeCounts = ""  # how often steps took how long, see `coding.time_counts`
    peak_mb: Annotated[float, msgspec.Meta(ge=0, le=1e9)] | None = None  # peak memory of the localizer in 10^6 bytes
    failure: Passage = ""  # why it is not complete, in one line


class LookRecord(_Record, frozen=True, kw_only=True):
    """How often the test split of a sealed environment had been looked at, as far as the sender's ledger knew."""

    package: Line  # of the localizer
    count: Count  # looks of that package
    why: Passage  # reason of the last one


class RunRecord(_Record, frozen=True, kw_only=True):
    """When, where and how long: nothing here goes into the digest of a submission."""

    started_at: Remark  # first moment of the walks, ISO 8601
    machine: Annotated[dict[Name, Remark | int], msgspec.Meta(max_length=20)]  # processor, cores, system
    # Each way in which walks were isolated
    isolation: Annotated[tuple[dict[str, Any], ...], msgspec.Meta(max_length=50)] = ()
    budget: Annotated[dict[Name, Finite], msgspec.Meta(max_length=20)] = {}  # time that the localizer was given
    # By environment, in the order of `EnvironmentRecord.walks`
    walks: Annotated[dict[Name, tuple[WalkRun, ...]], msgspec.Meta(max_length=200)]
    looks: Annotated[dict[Name, LookRecord], msgspec.Meta(max_length=200)] = {}  # by sealed environment


class HeldOut(_Record, frozen=True, kw_only=True):
    """Scores on walks that cannot be made without the secret."""

    commitment: Sha256  # sha256 of the secret
    walks: Count  # how many
    seeds: Count  # runs of each
    # Value, low, high by name of the metric; None where it does not apply
    metrics: Annotated[dict[Name, tuple[Finite | None, Finite | None, Finite | None]], msgspec.Meta(max_length=200)]


class Verification(_Record, frozen=True, kw_only=True):
    """What a maintainer found when running a submission again."""

    reran: Count  # walks and seeds run again, all of them to the same bytes
    of: Count  # walks and seeds there are
    is_deterministic: bool  # whether running twice with one seed gave the same bytes
    isolation: Remark  # mode of isolation while verifying
    versions: Annotated[dict[Name, Remark], msgspec.Meta(max_length=20)]  # of pdrbench, NumPy, Python while verifying
    # Scores on held-out walks; None where there was no secret, or the walks are recorded ones
    held_out: HeldOut | None = None
