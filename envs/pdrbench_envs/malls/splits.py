"""Which walks of the malls are train, val and test, and which of them the radio survey of a walk is made of.

Splits, folds and surveys are made of *outings* (`pdrbench_formats.outings`) of recording sessions of one mall, over
floors. No session is ever cut, and no walk is chosen: outings are drawn by a keyed hash. Where parts of one outing lie
in different splits, sessions within ten minutes of the other side stay walks of their split and are left out of its
survey.
"""

from __future__ import annotations

import csv
import functools
import hashlib
import itertools
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files as package_files
from typing import Final

from pdrbench.datasets import datasets
from pdrbench_formats.outings import is_near, parted

UNSEEN_FLOORS: Final = (("site2", "F3"), ("site2", "F8"))  # the floors with the fewest walks, until they hold thirty
LATER_S: Final = 1575475200.0  # 2019-12-05 00:00 in the time zone of the malls (UTC+8), unix
SURVEY_ENDS_S: Final = 1575129600.0  # 2019-12-01 00:00 there: what is recorded later is in no survey
KNOWN, UNSEEN, LATER = "known floor", "unseen floor", "two weeks later"
NUM_FOLDS: Final = 5
TEST_WALKS, VAL_WALKS = 80, 76  # of the known floors, about: a draw stops at the first outing beyond
# Of the pairs of draws that `malls.draw` compares, the one that leaves the test and the validation walks the densest
# survey. It looks at places and times only, at no estimate.
TEST_DRAW: Final = 104
VAL_DRAW: Final = 40
PLAYED_BEFORE: Final = ("train", "eval", "edge")  # roles in `ilc20` of the walks that `MallPhone` played at first


@dataclass(frozen=True, slots=True)
class Walk:
    """One walk of `ilc20_full`, without opening it."""

    path: str  # relative to the folder of the set
    session: str  # its walks follow one another within a minute on one floor
    start_s: float  # unix
    end_s: float

    @property
    def site(self) -> str:
        """Name of the mall."""
        return self.path.split("/")[0]

    @property
    def floor(self) -> str:
        """Name of the floor."""
        return self.path.split("/")[1]

    @property
    def group(self) -> str:
        """The group of results that it counts in if it is a test walk."""
        if (self.site, self.floor) in UNSEEN_FLOORS:
            return UNSEEN
        return LATER if self.start_s >= LATER_S else KNOWN


@dataclass(frozen=True, slots=True)
class Session:
    """Walks that were recorded without a break."""

    name: str
    walks: tuple[Walk, ...]  # in order of time

    @property
    def start_s(self) -> float:
        """Of its first walk, unix."""
        return self.walks[0].start_s

    @property
    def end_s(self) -> float:
        """Of its last walk, unix."""
        return max(walk.end_s for walk in self.walks)

    def is_near(self, other: Session) -> bool:
        """True where both are of one mall and less than the guard apart."""
        return self.walks[0].site == other.walks[0].site and is_near(self, other)


Outing = tuple[Session, ...]  # in order of time


@dataclass(frozen=True, slots=True)
class Splits:
    """Outings by split and, of train, by fold."""

    train: tuple[tuple[Outing, ...], ...]  # by fold
    val: tuple[Outing, ...]
    test: tuple[Outing, ...]

    def survey(self, of: str | int) -> tuple[Walk, ...]:
        """The walks whose scans are given to walks of "val", of "test", or of a fold of train, sorted by path.

        They are walks of train, recorded before `SURVEY_ENDS_S` and more than the guard from every session of `of`.
        """
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
def walks() -> tuple[Walk, ...]:
    """Every walk of the set, sorted by path."""
    text = (package_files("pdrbench_envs.malls") / "walks.csv").read_text(encoding="utf-8")
    made = []
    for row in csv.DictReader(text.splitlines()):
        start_s = float(row["start_s"])
        made.append(Walk(row["path"], row["session"], start_s, start_s + float(row["duration_s"])))
    return tuple(sorted(made, key=lambda walk: walk.path))


@functools.cache
def played_before() -> frozenset[str]:
    """Names of the files, without suffix, of the walks that localizers were developed on."""
    rows = datasets()["ilc20"].files
    return frozenset(row.path.split("/")[-1].partition(".")[0] for row in rows if row.role in PLAYED_BEFORE)


def is_new(walk: Walk) -> bool:
    """True where no localizer was developed on the walk: `MallPhone` did not play it at first."""
    return walk.path.split("/")[-1].partition(".")[0] not in played_before()


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
    of_session: dict[str, list[Walk]] = defaultdict(list)
    for walk in sorted(walks(), key=lambda walk: walk.start_s):
        of_session[walk.session].append(walk)
    sessions = [Session(name, tuple(of)) for name, of in of_session.items()]
    outings = tuple(outings_of(sorted(sessions, key=lambda s: (s.walks[0].site, s.walks[0].group, s.start_s))))
    is_known = [outing[0].walks[0].group == KNOWN for outing in outings]
    known = tuple(outing for outing, known in zip(outings, is_known, strict=True) if known)
    return known, tuple(outing for outing, known in zip(outings, is_known, strict=True) if not known)


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
    return sorted(outings, key=lambda outing: hashlib.blake2b(outing[0].name.encode(), digest_size=8, key=key).digest())
