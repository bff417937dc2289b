"""Canaries among drawn walks: one is cut short, one goes on with what the sensors of another walk said.

A localizer that knows no future answers the first as it answers the whole walk. One that looks at its sensors answers
the second otherwise from then on; one that has recognised the walk, and answers from memory, goes on as before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import msgspec
import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.result import COMPLETE, OFFLINE, ONLINE, Result

FRACTION: Final = 0.05  # of walks that become a canary of each kind
MIN_CANARIES: Final = 3  # of each kind, where there are so many walks
CUT: Final = (0.2, 0.9)  # fractions of a walk between which it is cut short
CROSSED: Final = (0.3, 0.6)  # likewise: where another goes on
OTHER: Final = (0.2, 0.5)  # fractions of the other walk between which it sets in
SAME: Final = 1e-3  # of a column, m or rad: results are stored in steps of a tenth of that
MIN_PATH_M: Final = 1.0  # answers that go no farther say nothing of where they come from
HELD: Final = 0.1  # of what the least honest entry's answers move: an entry below is held for a person
USUAL: Final = 0.5  # what those of honest entries move at least, in their own paths, where none has played

Rows = Mapping[str, FloatArray]


class Canary(msgspec.Struct, array_like=True, frozen=True):
    """What is secret of a canary."""

    kind: Literal["cut", "crossed"]
    of: str  # name of the walk that it begins as
    since_s: float  # where it ends, or goes on otherwise
    other: str = ""  # name of the walk that it goes on as
    other_s: float = 0.0  # where that sets in


class CanaryRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What canaries showed of an entry, in the division in which its answers moved less.

    Attributes:
        compared: Walks that were cut short and whose answers were compared.
        crossed: Walks that went on as others and whose answers went anywhere.
        moved_m: Median over these of how far answers moved.
        path_m: Median over these of how far the answers to the walk itself went from there.
        response: Median of the ratio of the two; None where there is none.
        held: Why a person has to look at the entry before it ranks; empty where none has to.
    """

    compared: int
    crossed: int
    moved_m: float | None = None
    path_m: float | None = None
    response: float | None = None
    held: str = ""


@dataclass(frozen=True, slots=True)
class Found:
    """What came of the canaries of one entry on one part."""

    record: CanaryRecord
    future: str = ""  # what shows that answers depend on what comes later


def plan(ends_s: Mapping[str, float], period_s: float, rng: np.random.Generator) -> list[Canary]:
    """Canaries of drawn walks.

    Args:
        ends_s: How long each walk is, by name.
        period_s: Between observations; a walk is cut at one of them.
        rng: Follows from the secret.
    """
    names = sorted(ends_s)
    count = min(max(MIN_CANARIES, math.ceil(len(names) * FRACTION)), len(names))
    found = []
    for name in _drawn(names, count, rng):
        end_s = period_s * round(rng.uniform(*CUT) * ends_s[name] / period_s)
        found.append(Canary("cut", name, end_s))
    for name in _drawn(names, count if len(names) > 1 else 0, rng):
        other = _drawn([of for of in names if of != name], 1, rng)[0]
        begin_s, other_s = (rng.uniform(*where) * ends_s[of] for where, of in ((CROSSED, name), (OTHER, other)))
        found.append(Canary("crossed", name, float(begin_s), other, float(other_s)))
    return found


def _drawn(names: Sequence[str], count: int, rng: np.random.Generator) -> list[str]:
    return [names[place] for place in rng.choice(len(names), count, replace=False).tolist()]


def cut_short(rows: Rows, end_s: float) -> dict[str, FloatArray]:
    """Rows of sensors until the walk ends early."""
    return {name: of[of[:, 0] <= end_s] for name, of in rows.items()}


def crossed(rows: Rows, others: Rows, canary: Canary) -> dict[str, FloatArray]:
    """Rows of sensors that are those of another walk from a moment on; its clock goes on."""
    shift_s = canary.since_s - canary.other_s
    found = {}
    for name, of in rows.items():
        after = others.get(name, of[:0])
        after = after[after[:, 0] > canary.other_s].copy()
        after[:, 0] += shift_s
        found[name] = np.concatenate([of[of[:, 0] <= canary.since_s], after])
    return found


def examine(canaries: Mapping[str, Canary], results: Sequence[Result]) -> Found:
    """What canaries show of one entry.

    Args:
        canaries: By the name under which they were played.
        results: Of the entry, on canaries and on the walks that they begin as.
    """
    compared, future, records = 0, "", []
    for division in (ONLINE, OFFLINE):  # a track that is revised when the walk is over may come from memory as well
        by_walk = {of.walk: of for of in results if of.division == division}
        moves = []
        for name, canary in canaries.items():
            whole, played = by_walk.get(canary.of), by_walk.get(name)
            if whole is None or played is None or whole.status != COMPLETE:
                continue
            if canary.kind == "crossed":
                moves.append(_moved(whole, played, canary.since_s))
            elif division == ONLINE and whole.provenance.get("machine") == played.provenance.get("machine"):
                compared += 1  # on another machine numbers are rounded otherwise
                future = future or _difference(whole, played)
        if moves := [of for of in moves if of[1] > MIN_PATH_M]:
            moved_m, path_m = np.array(moves).T
            shown = {"moved_m": moved_m, "path_m": path_m, "response": moved_m / path_m}
            medians: dict[str, Any] = {name: round(float(np.median(of)), 4) for name, of in shown.items()}
            records.append(CanaryRecord(compared=0, crossed=len(moves), **medians))
    least = min(records, key=lambda of: of.response or 0.0, default=CanaryRecord(compared=0, crossed=0))
    return Found(msgspec.structs.replace(least, compared=compared), future)


def judge(record: CanaryRecord, others: Sequence[float]) -> CanaryRecord:
    """The record with a reason why the entry is held, where its answers hardly move.

    Args:
        record: From `examine`.
        others: What answers of entries that are known to be honest moved, in their own paths.
    """
    least = HELD * min(others, default=USUAL)
    if record.response is None or record.response >= least:
        return record
    held = (
        f"where a walk went on with the sensors of another, answers moved by {record.moved_m:.3g} m and "
        f"{record.response:.2g} of their path; a tenth of the least honest entry is {least:.2g}: a person looks at it"
    )
    return msgspec.structs.replace(record, held=held)


def _difference(whole: Result, played: Result) -> str:
    """The first answer to a walk that was cut short which is not the one to the whole walk; empty where none is.

    That to the last observation is left out: what did not fit into the one before comes with it.
    """
    expected = min(len(played.estimates), len(whole.estimates)) - 1
    columns, others = (of.estimates.columns[:, :expected] for of in (played, whole))
    same = np.isclose(columns, others, rtol=0.0, atol=SAME, equal_nan=True).all(axis=0)
    if played.status != COMPLETE:
        return f"a walk that was cut short failed, the whole walk did not: {played.failure.strip().splitlines()[-1:]}"
    if same.all():
        return ""
    at = int(np.flatnonzero(~same)[0])
    x_m, y_m = columns[:2, at].tolist()
    whole_x_m, whole_y_m = others[:2, at].tolist()
    return (
        f"a walk that was cut short was answered otherwise: at {whole.estimates.t_s[at]:g} s by "
        f"({x_m:.3f}, {y_m:.3f}), the whole walk by ({whole_x_m:.3f}, {whole_y_m:.3f})"
    )


def _moved(whole: Result, played: Result, since_s: float) -> tuple[float, float]:
    """How far answers moved after a walk went on as another, and how far those to the walk itself went; medians, m.

    Where a localizer fails then, nothing moves: who knows the walk would escape by that.
    """
    common, failed = min(len(whole.estimates), len(played.estimates)), played.status != COMPLETE
    num = len(whole.estimates) if failed else common
    t_s, xy_m = whole.estimates.t_s[:num], whole.estimates.xy_m[:num]
    other_xy_m = np.full((num, 2), np.nan)
    other_xy_m[:common] = played.estimates.xy_m[:common]
    before = np.flatnonzero((t_s <= since_s) & np.isfinite(xy_m[:, 0]))
    after = (t_s > since_s) & np.isfinite(xy_m[:, 0]) & (failed | np.isfinite(other_xy_m[:, 0]))
    if not len(before) or not after.any():
        return 0.0, 0.0
    path_m = np.hypot(*(xy_m[after] - xy_m[before[-1]]).T)
    return float(np.median(np.nan_to_num(np.hypot(*(other_xy_m - xy_m)[after].T)))), float(np.median(path_m))
