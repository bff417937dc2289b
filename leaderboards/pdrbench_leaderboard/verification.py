"""What a maintainer found when running an entry again: `verification.json`, signed, with `rerun.bin` beside it.

A tier comes from such a record alone, and a record is of one entry: it names the digest of everything that was sent.
"""

from __future__ import annotations

import datetime
from typing import Annotated, Any, Final, Literal

import msgspec

from pdrbench.errors import BundleError
from pdrbench_leaderboard.manifest import MAX_SEEDS, Finite, Record, Walks
from pdrbench_leaderboard.schema import Count, EntryName, Name, Nonce, Remark, Sha256, read_json
from pdrbench_leaderboard.signing import Keys, UnknownKeyError, signed_text

VERIFICATION_FILE: Final = "verification.json"
RERUN_FILE: Final = "rerun.bin"  # estimates of the public walks with the second nonce
HELD_OUT_FILE: Final = "held_out.bin"  # estimates on held-out walks; published when their round is over

SELF_REPORTED: Final = "self-reported"
SPOT_CHECKED: Final = "spot-checked"
REPRODUCED: Final = "reproduced"
VERIFIED: Final = "verified"
TIERS: Final = (SELF_REPORTED, SPOT_CHECKED, REPRODUCED, VERIFIED)  # each is worth more than those before it


class OtherEntryError(BundleError):
    """A verification of another entry than the one that it lies beside."""


class HeldOut(Record, frozen=True, kw_only=True):
    """What came of the held-out walks. Failed and declined runs count as the worst answer, see `held_out`."""

    round: Sha256  # sha256 of the secret behind the walks
    estimates_sha256: Sha256  # of `held_out.bin`
    seeds: Annotated[int, msgspec.Meta(ge=1, le=MAX_SEEDS)]
    # Of each run, walks in order, seeds of a walk side by side: complete, failed or declined, by their first letter
    statuses: Annotated[str, msgspec.Meta(pattern=r"^[cfd]+\Z", max_length=500_000)]
    units: Annotated[tuple[Count, ...], msgspec.Meta(min_length=1, max_length=5000)]  # number of each walk's unit
    # By metric: of each walk, mean over seeds; None where it does not apply
    values: Annotated[dict[Name, tuple[Finite | None, ...]], msgspec.Meta(min_length=1, max_length=50)]

    @property
    def failed(self) -> int:
        """How many runs failed."""
        return self.statuses.count("f")

    @property
    def declined(self) -> int:
        """How many runs were declined."""
        return self.statuses.count("d")


class Verification(Record, frozen=True, kw_only=True):
    """The text that is signed."""

    schema: Literal[2]
    suite: Name
    env: Name
    localizer: EntryName
    entry_sha256: Sha256  # `Entry.sha256` of what was sent
    tier: Literal["spot-checked", "reproduced", "verified"]
    date: datetime.date
    nonce: Nonce  # of the second run
    reran: Count  # runs of a walk with a seed that were played again and agree with those that were sent
    of: Count  # runs that were sent
    versions: Annotated[dict[Name, Remark], msgspec.Meta(max_length=20)]
    machine: Annotated[dict[Name, Remark | int], msgspec.Meta(max_length=20)]
    # Each way in which walks were isolated
    isolation: Annotated[tuple[dict[str, Any], ...], msgspec.Meta(max_length=50)]
    walks: Walks = ()  # of the second run; none of a spot check
    estimates_sha256: Sha256 | None = None  # of `rerun.bin`; None for a spot check
    held_out: HeldOut | None = None


def read_verification(content: bytes, keys: Keys, what: str) -> Verification:
    """The signed record in a file.

    Raises:
        BundleError: One of the errors of `signing`, or what is signed is no record of this version.
    """
    text, key = signed_text(content, keys, what)
    found = read_json(text.encode(), Verification, what)
    if found.date < key.since:
        raise UnknownKeyError(f"{what} is of {found.date}, and its key counts from {key.since} on")
    if (found.tier == VERIFIED) != (found.held_out is not None):
        raise BundleError(f"{what}: {found.tier} goes with held-out walks or without, and not as here")
    if found.tier != SPOT_CHECKED and found.reran != found.of:
        raise BundleError(f"{what}: {found.tier}, and only {found.reran} of {found.of} runs were run again")
    if (found.tier == SPOT_CHECKED) != (not found.walks) or (found.estimates_sha256 is None) != (not found.walks):
        raise BundleError(f"{what}: {found.tier} goes with a second run or without, and not as here")
    if found.held_out is not None:
        _check_lengths(found.held_out, what)
    return found


def _check_lengths(found: HeldOut, what: str) -> None:
    lengths = {len(values) for values in found.values.values()}
    if lengths != {len(found.units)}:
        raise BundleError(f"{what}: values of {sorted(lengths)} held-out walks, units of {len(found.units)}")
    if len(found.statuses) != len(found.units) * found.seeds:
        raise BundleError(f"{what}: {len(found.statuses)} runs of {len(found.units)} walks with {found.seeds} seeds")


def check_belongs(found: Verification, entry: tuple[str, str, str, str], what: str) -> None:
    """Raises `OtherEntryError` where a record is not of this suite, environment, localizer and content."""
    names = ("suite", "env", "localizer", "entry_sha256")
    for name, here in zip(names, entry, strict=True):
        there = getattr(found, name)
        if there != here:
            raise OtherEntryError(f"{what} is of another entry: its {name} is {there[:40]}, here it is {here[:40]}")
