"""Draws the parts of the malls, and compares draws by how dense a survey they leave.

`python -m pdrbench_lab.malls.draw` prints the best draw; `walks.csv` of the environment has what came of it.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from pdrbench.geometry import FloatArray
from pdrbench_envs.malls.splits import KNOWN, NUM_FOLDS, SURVEY_ENDS_S, Session, Walk, sessions, walks
from pdrbench_envs.malls.surveys import Scans, scans_of
from pdrbench_formats.outings import parted

TEST_WALKS, VAL_WALKS = 80, 76  # of the known floors, about: a draw stops at the first outing beyond
# Of the pairs of draws that are compared, the one that leaves the test and the validation walks the densest survey. It
# looks at places and times only, at no estimate.
TEST_DRAW: Final = 104
VAL_DRAW: Final = 40

NUM_DRAWS = 200
NUM_COMPARED = 20
NEAR_M = 10.0
TEST_RANGE, VAL_RANGE = (84, 92), (75, 85)  # new walks on known floors, see `Walk.is_new`
MIN_OUTINGS = 14  # intervals resample outings


Outing = tuple[Session, ...]  # in order of time


@dataclass(frozen=True, slots=True)
class Splits:
    """Outings by split and, of train, by fold."""

    train: tuple[tuple[Outing, ...], ...]  # by fold
    val: tuple[Outing, ...]
    test: tuple[Outing, ...]

    def survey(self, of: str | int) -> tuple[Walk, ...]:
        """As `pdrbench_envs.malls.splits.survey_of`, after this draw."""
        guarded = self.train[of] if isinstance(of, int) else {"val": self.val, "test": self.test}[of]
        away = [session for outing in guarded for session in outing]
        kept = [
            session
            for fold, outings in enumerate(self.train)
            for outing in outings
            for session in outing
            if fold != of and session.start_s < SURVEY_ENDS_S and not any(session.is_near(other) for other in away)
        ]
        return tuple(sorted((walk for session in kept for walk in session.walks), key=lambda walk: walk.path))


@functools.cache
def splits(test_draw: int = TEST_DRAW, val_draw: int | None = VAL_DRAW) -> Splits:
    """The splits after two draws; without walks for validation where the second is None."""
    known, others = known_and_other_outings()
    test = drawn(known, TEST_WALKS, f"test {test_draw}")
    rest = [outing for outing in known if outing not in test]
    val = [] if val_draw is None else drawn(rest, VAL_WALKS, f"val {val_draw}")
    train = [outing for outing in rest if outing not in val]
    return Splits(_folds(train), tuple(val), (*test, *others))


@functools.cache
def known_and_other_outings() -> tuple[tuple[Outing, ...], tuple[Outing, ...]]:
    """Outings on known floors before 5 December, of which test and val are drawn; and the others, which are test."""
    in_order = sorted(sessions(), key=lambda s: (s.walks[0].site, s.walks[0].group, s.start_s))
    outings = tuple(outings_of(in_order))
    known = tuple(outing for outing in outings if outing[0].walks[0].group == KNOWN)
    return known, tuple(outing for outing in outings if outing[0].walks[0].group != KNOWN)


def outings_of(sessions: Iterable[Session]) -> Iterator[Outing]:
    """Sessions in order of mall, group and time, parted into outings."""
    for _, of_group in itertools.groupby(sessions, key=lambda each: (each.walks[0].site, each.walks[0].group)):
        yield from parted(of_group)


def num_walks(outing: Outing) -> Counter[tuple[str, str]]:
    """Walks by mall and floor."""
    return Counter((walk.site, walk.floor) for session in outing for walk in session.walks)


def drawn(outings: Sequence[Outing], target: int, draw: str) -> list[Outing]:
    """Outings in the order of a keyed hash, each taken where every floor in it still lacks walks.

    A floor lacks walks until it has its part of `target`, in proportion to the walks of all floors.
    """
    total = sum((num_walks(outing) for outing in outings), Counter[tuple[str, str]]())
    quota = {floor: target * count / total.total() for floor, count in total.items()}
    taken, have = [], Counter[tuple[str, str]]()
    for outing in _shuffled(outings, draw):
        count = num_walks(outing)
        if all(have[floor] + count[floor] / 2 < quota[floor] for floor in count):
            taken.append(outing)
            have += count
    return taken


def _folds(train: Sequence[Outing]) -> tuple[tuple[Outing, ...], ...]:
    """Outings in the order of a keyed hash, each in the fold with the fewest walks of its floors."""
    folds: list[list[Outing]] = [[] for _ in range(NUM_FOLDS)]
    have = [Counter[tuple[str, str]]() for _ in folds]
    for outing in _shuffled(train, "folds"):
        count = num_walks(outing)
        fold = min(range(NUM_FOLDS), key=lambda k: (sum(have[k][floor] for floor in count), have[k].total()))
        folds[fold].append(outing)
        have[fold] += count
    return tuple(tuple(fold) for fold in folds)


def _shuffled(outings: Iterable[Outing], draw: str) -> list[Outing]:
    key = f"pdrbench.malls {draw}".encode()
    return sorted(
        outings,
        key=lambda outing: hashlib.blake2b(outing[0].walks[0].session.encode(), digest_size=8, key=key).digest(),
    )


def scans_of_site(site: str) -> Scans:
    """Scans and waypoints of every walk of a mall."""
    return scans_of(tuple(walk.path for walk in walks() if walk.site == site))


def distances_m(played: Iterable[Walk], survey: Sequence[Walk]) -> FloatArray:
    """(P,) from each waypoint to the nearest scan of a survey on the same floor; infinite where there is none."""
    of_floor: dict[tuple[str, str], list[str]] = {}
    for walk in played:
        of_floor.setdefault((walk.site, walk.floor), []).append(walk.path)
    found: list[FloatArray] = [np.zeros(0)]
    for (site, floor), paths in sorted(of_floor.items()):
        scans = scans_of_site(site)
        xy_m = scans.waypoint_xy_m(paths)
        near = scans.scan_xy_m([walk.path for walk in survey if (walk.site, walk.floor) == (site, floor)])
        found.append(np.asarray(cKDTree(near).query(xy_m)[0]) if len(near) else np.full(len(xy_m), np.inf))
    return np.concatenate(found)


def played(outings: Iterable[Outing], group: str = KNOWN) -> list[Walk]:
    """The walks of a group in some outings that are new, see `Walk.is_new`."""
    every = [walk for outing in outings for session in outing for walk in session.walks]
    return [walk for walk in every if walk.group == group and walk.is_new]


def density(walks_of: Sequence[Walk], survey: Sequence[Walk]) -> float:
    """The fraction of waypoints within `NEAR_M` of a scan."""
    return float((distances_m(walks_of, survey) <= NEAR_M).mean())


def best_draws() -> tuple[int, int]:
    """The draw of test and the draw of val whose less dense survey is the densest of all pairs that are compared.

    Compared are pairs with enough walks, enough outings and every known floor in both, of the draws of test with the
    densest survey before walks are kept for val. It looks at places and times only, at no estimate.
    """
    of_test = {draw: _densities(draw, None)[0] for draw in range(NUM_DRAWS)}
    densest = sorted(of_test, key=lambda draw: -of_test[draw])[:NUM_COMPARED]
    pairs = [(test_draw, val_draw) for test_draw in densest for val_draw in range(NUM_DRAWS)]
    return max(pairs, key=lambda pair: min(_densities(*pair)))


def _densities(test_draw: int, val_draw: int | None) -> tuple[float, ...]:
    """Density of the survey of test walks on known floors and of val walks; -1 where a draw does not qualify."""
    made = splits(test_draw, val_draw)
    outings = [outing for outing in made.test if outing[0].walks[0].group == KNOWN]
    of_split = [("test", outings, TEST_RANGE)] + ([] if val_draw is None else [("val", list(made.val), VAL_RANGE)])
    floors = {floor for outing in known_and_other_outings()[0] for floor in num_walks(outing)}
    found = []
    for split, drawn, (fewest, most) in of_split:
        walks_of = played(drawn)
        is_enough = fewest <= len(walks_of) <= most and len(drawn) >= MIN_OUTINGS
        if not is_enough or {(walk.site, walk.floor) for walk in walks_of} != floors:
            return (-1.0, -1.0)
        found.append((walks_of, made.survey(split)))
    return tuple(density(*each) for each in found)


def main() -> None:
    """Prints the two draws."""
    print("TEST_DRAW = {}, VAL_DRAW = {}".format(*best_draws()), file=sys.stderr)  # noqa: T201


if __name__ == "__main__":
    main()
