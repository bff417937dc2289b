"""`leaderboard check`: whether what is kept of the boards holds together, and how much each board can tell."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import BundleError, DatasetError, PdrbenchError
from pdrbench.evaluation import answers
from pdrbench.geometry import FloatArray
from pdrbench_leaderboard import table
from pdrbench_leaderboard.boards import PRIVATE, Board
from pdrbench_leaderboard.draw import make_truth, opaque_names
from pdrbench_leaderboard.record import (
    PartWalks,
    held,
    is_verified,
    list_entries,
    numbers,
    read_answers,
    read_entry,
    read_walks,
)
from pdrbench_leaderboard.schema import Finding
from pdrbench_leaderboard.score import kept_metrics, walk_values
from pdrbench_leaderboard.standings import DIVISIONS, RANKING, Entry, Table, read_tables

SAMPLED: Final = 2  # walks of each part whose scores are computed again
SAME: Final = 0.01  # difference of a score that two machines may have
ALIKE: Final = 0.95  # fraction of walks on which it may not be larger
MIN_SCORE_M: Final = 1e-3  # nobody is nearer than the reference is


@dataclass(frozen=True, slots=True)
class Separability:
    """How many pairs of a board's entries are significantly different."""

    board: str
    entries: int
    pairs: int
    significant: int


def separability(board: Board, tables: Sequence[Table]) -> Separability:
    """Entries of a board, and pairs of them that are separated, both divisions together."""
    names = {row.name for of in tables for row in of.rows}
    return Separability(board.name, len(names), sum(of.num_pairs for of in tables), sum(of.num_apart for of in tables))


def check_board(root: Path, board: Board) -> Iterator[Finding]:
    """Checks every entry of a board and its table.

    An entry passes where its files belong together, and where the scores of some walks come out of its answers. What
    needs recorded data that is not found, or a secret that is not published, passes and says so.

    Args:
        root: Holds the boards.
        board: To be checked.
    """
    walks = read_walks(root / board.name)
    entries: list[Entry] = []
    for folder in list_entries(root, board.name):
        try:
            entry = Entry(*read_entry(folder), folder)
            if not is_verified(folder, entry.record):
                why = held(entry.record) or "no maintainer has played it"
                yield Finding(f"{board.name}/{folder.name}", True, f"listed, not ranked: {why}")
            for of, division in itertools.product(walks.values(), DIVISIONS):
                entry.division(of, division)
            entries.append(entry)
            yield Finding(f"{board.name}/{entry.name}", True)
        except PdrbenchError as error:
            yield Finding(f"{board.name}/{folder.name}", False, str(error))
    for of in walks.values():
        yield from _scores(board, entries, of)
    yield _table(root, board)


def compare_entries(one: Path, other: Path) -> list[Finding]:
    """Whether two runs of a localizer on the same walks agree by score, wherever they were; bytes do not count.

    A part agrees where the scores of `ALIKE` of its walks do, to `SAME`, and the mean logarithm of the first lies
    within the 95 % interval of that of the second.

    Args:
        one: Folder of an entry.
        other: Likewise, of another run.

    Raises:
        BundleError: One is no entry, or they have no part in common.
    """
    found = []
    records = [read_entry(folder)[0] for folder in (one, other)]
    for mine, theirs in itertools.product(*(record.parts for record in records)):
        if (mine.place, mine.walks_sha256) != (theirs.place, theirs.walks_sha256):
            continue
        for first, second in itertools.product(mine.divisions, theirs.divisions):
            if first.division == second.division:
                why = disagree(*(np.maximum(numbers(of.values[RANKING]), MIN_SCORE_M) for of in (first, second)))
                found.append(Finding(f"{mine.env}, {mine.part}, {first.division}", not why, why))
    if not found:
        raise BundleError(f"{one} and {other} have not played the same walks: draw both from the same round and secret")
    return found


def disagree(mine_m: FloatArray, theirs_m: FloatArray) -> str:
    """Why (W,) scores of walks of two runs do not agree; empty where they do."""
    if mine_m.shape != theirs_m.shape:
        return f"{len(mine_m)} and {len(theirs_m)} walks"
    alike = np.isclose(mine_m, theirs_m, rtol=SAME, atol=0.0, equal_nan=True)
    logs, others = (np.log(of[np.isfinite(mine_m) & np.isfinite(theirs_m)]) for of in (mine_m, theirs_m))
    width = 1.96 * others.std(ddof=1) / np.sqrt(len(others)) if len(others) > 1 else 0.0
    is_near = not len(logs) or abs(logs.mean() - others.mean()) <= max(width, SAME)
    if alike.mean() >= ALIKE and is_near:
        return ""
    return (
        f"{alike.sum()} of {len(alike)} walks agree; the mean is {np.exp((logs - others).mean()):.3f} times the other"
    )


def _scores(board: Board, entries: Sequence[Entry], walks: PartWalks) -> Iterator[Finding]:
    """Whether scores of the first walks come out of the answers."""
    name = f"{board.name}: {walks.env}, {walks.part}"
    if walks.part == PRIVATE:
        yield Finding(name, True, "not scored: its truth is with its host alone")
        return
    secret = board.round(walks.round).secret
    if not secret:
        yield Finding(name, True, f"not scored: the secret of round {walks.round} is not published")
        return
    listed = board.environment(walks.env)
    if not listed.is_here:
        yield Finding(name, True, "not scored: its recordings are with its host alone")
        return
    try:
        names = opaque_names(listed, walks.part, secret)
        task = listed.task(walks.part, secret)
        truths = [make_truth(task, task.load(names[walk.name])) for walk in walks.walks[:SAMPLED]]
    except (DatasetError, KeyError) as error:
        is_absent = isinstance(error, DatasetError)
        yield Finding(name, is_absent, f"not scored: {error}" if is_absent else "its walks are others by now")
        return
    for entry in entries:
        found = entry.division(walks, "online")
        if found is None:
            continue
        whole, _ = answers.decode(read_answers(entry.folder), entry.name, found.begin)
        first, wrong = 0, ""
        for place, (walk, truth) in enumerate(zip(walks.walks, truths, strict=False)):
            rows = whole[:, first : first + walk.moments]
            first += walk.moments
            if found.statuses[place] != "c":
                continue
            estimates = answers.from_whole_numbers(rows, truth.reference.t_s, answers.COARSE)
            again = walk_values(estimates, truth, board.metric)
            for metric in kept_metrics(board.metric):
                stated = numbers(found.values[metric])[place]
                if not np.isclose(again[metric], stated, rtol=SAME, atol=SAME, equal_nan=True):
                    wrong = f"{metric} of walk {walk.name} is {stated:.4g}, its answers give {again[metric]:.4g}"
        yield Finding(f"{name}: {entry.name}", not wrong, wrong)


def _table(root: Path, board: Board) -> Finding:
    path = root / board.name / table.FILE_NAME
    name = f"{board.name}/{table.FILE_NAME}"
    try:
        tables = read_tables(root, board)
    except PdrbenchError as error:
        return Finding(name, False, str(error))
    found = path.read_text(encoding="utf-8") if path.is_file() else ""
    if not found and not tables:
        return Finding(name, True)
    wanted = table.page(board, tables)
    if found == wanted:
        return Finding(name, True)
    line = next((line for line in wanted.splitlines() if line not in found.splitlines()), "a line is too many")
    return Finding(name, False, f"{line[:120]}: write it anew with `pdrbench leaderboard build`")
