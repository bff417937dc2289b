"""What a submission says of itself: what was run (`Manifest`), and what differs from run to run (`RunRecord`)."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

import msgspec

from pdrbench.leaderboard.schema import Count, Line, Name, Passage, Remark, Sha256

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
TimeCounts = Annotated[str, msgspec.Meta(pattern=r"^([0-9]{1,3}:[0-9]{1,7}( |$))*$", max_length=5000)]


class _Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    pass


class WalkRecord(_Record, frozen=True, kw_only=True):
    """One walk with one seed.

    Attributes:
        walk: Id.
        seed: Seed.
        status: As in `pdrbench.result.Result`.
        division: "offline" where the past was revised.
        rows: Observations that were answered.
        sha256: Digest of the rounded estimates.
        missing: Count by reason of answers that count as missing.
    """

    walk: Name
    seed: Annotated[int, msgspec.Meta(ge=0, le=1_000_000)]
    status: Status
    division: Division
    rows: Annotated[int, msgspec.Meta(ge=0, le=1_000_000)]
    sha256: Sha256
    missing: Annotated[dict[Name, Count], msgspec.Meta(max_length=100)] = {}


class EnvironmentRecord(_Record, frozen=True, kw_only=True):
    """The walks of one environment.

    Attributes:
        env: Id.
        split: Always "test": held-out walks are for verification.
        period_s: Between observations.
        task_sha256: Digest of what the walks are made from.
        deterministic: Whether two seeds gave the same bytes, so that one was kept.
        walks: In the order of the split, seeds of a walk side by side.
    """

    env: Name
    split: Literal["test"]
    period_s: Annotated[float, msgspec.Meta(gt=0, le=3600)]
    task_sha256: Sha256
    deterministic: bool
    walks: Annotated[tuple[WalkRecord, ...], msgspec.Meta(min_length=1, max_length=5000)]


class Manifest(_Record, frozen=True, kw_only=True):
    """What was run, and digests of what came of it: the same bytes whenever and wherever the same is run.

    Attributes:
        schema: Version of this format.
        suite: Name of the suite.
        localizer: Id on the leaderboards; `name` of the card.
        spec: As it was run: a registered id, `package.module:Class`, or `file.py:Class` for a file in `source`.
        seeds: Runs of every walk of a localizer that draws random numbers.
        parameters: Keyword arguments of its class.
        versions: Of pdrbench, NumPy, Python.
        core_sha256: Digest of the code of pdrbench that makes estimates.
        localizer_sha256: Digest of the localizer's own code.
        card_sha256: Of `card.toml`.
        source: Sha256 by name of the files that travel with it.
        unsuitable: Why it declined, by environment of the suite that it has no walks of.
        absent: Environments of the suite whose recorded data was not found.
        environments: With their walks.
    """

    schema: Literal[1] = 1
    suite: Name
    localizer: Name
    spec: Line
    seeds: Annotated[int, msgspec.Meta(ge=1, le=MAX_SEEDS)]
    parameters: dict[Name, Any] = {}
    versions: Annotated[dict[Name, Remark], msgspec.Meta(max_length=20)]
    core_sha256: Sha256
    localizer_sha256: Sha256
    card_sha256: Sha256
    source: Annotated[dict[Name, Sha256], msgspec.Meta(max_length=20)] = {}
    unsuitable: Annotated[dict[Name, Remark], msgspec.Meta(max_length=200)] = {}
    absent: Annotated[tuple[Name, ...], msgspec.Meta(max_length=200)] = ()
    environments: Annotated[tuple[EnvironmentRecord, ...], msgspec.Meta(max_length=200)]


class WalkRun(_Record, frozen=True, kw_only=True):
    """What differs from run to run of a walk.

    Attributes:
        reset_s: Wall time of `reset`; None where it was not measured.
        revise_s: Wall time of `revise`, likewise.
        step_times: How often steps took how long, see `coding.time_counts`.
        peak_mb: Peak memory of the localizer in 10^6 bytes.
        failure: Why it is not complete, in one line.
    """

    reset_s: Seconds | None = None
    revise_s: Seconds | None = None
    step_times: TimeCounts = ""
    peak_mb: Annotated[float, msgspec.Meta(ge=0, le=1e9)] | None = None
    failure: Passage = ""


class RunRecord(_Record, frozen=True, kw_only=True):
    """When, where and how long: nothing here goes into the digest of a submission.

    Attributes:
        started_at: First moment of the walks, ISO 8601.
        machine: Processor, cores, system.
        isolation: Each way in which walks were isolated.
        budget: Time that the localizer was given.
        walks: By environment, in the order of `EnvironmentRecord.walks`.
    """

    started_at: Remark
    machine: Annotated[dict[Name, Remark | int], msgspec.Meta(max_length=20)]
    isolation: Annotated[tuple[dict[str, Any], ...], msgspec.Meta(max_length=50)] = ()
    budget: Annotated[dict[Name, Finite], msgspec.Meta(max_length=20)] = {}
    walks: Annotated[dict[Name, tuple[WalkRun, ...]], msgspec.Meta(max_length=200)]


class HeldOut(_Record, frozen=True, kw_only=True):
    """Scores on walks that cannot be made without the secret.

    Attributes:
        commitment: Sha256 of the secret.
        walks: How many.
        seeds: Runs of each.
        metrics: Value, low, high by name of the metric; None where it does not apply.
    """

    commitment: Sha256
    walks: Count
    seeds: Count
    metrics: Annotated[dict[Name, tuple[Finite | None, Finite | None, Finite | None]], msgspec.Meta(max_length=200)]


class Verification(_Record, frozen=True, kw_only=True):
    """What a maintainer found when running a submission again.

    Attributes:
        reran: Walks and seeds run again, all of them to the same bytes.
        of: Walks and seeds there are.
        is_deterministic: Whether running twice with one seed gave the same bytes.
        isolation: Mode of isolation while verifying.
        versions: Of pdrbench, NumPy, Python while verifying.
        held_out: Scores on held-out walks; None where there was no secret, or the walks are recorded ones.
    """

    reran: Count
    of: Count
    is_deterministic: bool
    isolation: Remark
    versions: Annotated[dict[Name, Remark], msgspec.Meta(max_length=20)]
    held_out: HeldOut | None = None
