"""Which walks of the malls are train, val and test, and which of them the radio survey of a walk is made of.

Parts of the set and surveys are made of *outings* (`pdrbench_formats.outings`) of recording sessions of one mall, over
floors. No session is ever cut, and no walk was chosen: outings were drawn by a keyed hash, by the laboratory's
`malls.draw`, and `walks.csv` holds what came of it. Where pieces of one outing lie in different parts, sessions within
ten minutes of the other side stay walks of their part and are left out of its survey.
"""

from __future__ import annotations

import csv
import functools
from dataclasses import dataclass
from importlib.resources import files as package_files
from typing import Final

from pdrbench.datasets import datasets
from pdrbench_formats.outings import is_near

UNSEEN_FLOORS: Final = (("site2", "F3"), ("site2", "F8"))  # the floors with the fewest walks, until they hold thirty
LATER_S: Final = 1575475200.0  # 2019-12-05 00:00 in the time zone of the malls (UTC+8), unix
SURVEY_ENDS_S: Final = 1575129600.0  # 2019-12-01 00:00 there: what is recorded later is in no survey
KNOWN, UNSEEN, LATER = "known floor", "unseen floor", "two weeks later"
NUM_FOLDS: Final = 5
VAL, TEST = "val", "test"
PLAYED_BEFORE: Final = ("train", "eval", "edge")  # roles in `ilc20` of the walks that `MallPhone` played at first


@dataclass(frozen=True, slots=True)
class Walk:
    """One walk of `ilc20_full`, without opening it."""

    path: str  # relative to the folder of the set
    session: str  # its walks follow one another within a minute on one floor
    start_s: float  # unix
    end_s: float
    part: str | int  # "val", "test", or the number of its fold of train
    outing: str  # name of its first session

    @property
    def site(self) -> str:
        """Name of the mall."""
        return self.path.split("/")[0]

    @property
    def floor(self) -> str:
        """Name of the floor."""
        return self.path.split("/")[1]

    @property
    def split(self) -> str:
        """The split that it is in."""
        return self.part if isinstance(self.part, str) else "train"

    @property
    def group(self) -> str:
        """The group of results that it counts in if it is a test walk."""
        if (self.site, self.floor) in UNSEEN_FLOORS:
            return UNSEEN
        return LATER if self.start_s >= LATER_S else KNOWN

    @property
    def is_new(self) -> bool:
        """True where no localizer was developed on it: `MallPhone` did not play it at first."""
        return self.path.split("/")[-1].partition(".")[0] not in _played_before()


@dataclass(frozen=True, slots=True)
class Session:
    """Walks that were recorded without a break."""

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


@functools.cache
def walks() -> tuple[Walk, ...]:
    """Every walk of the set, sorted by path."""
    text = (package_files("pdrbench_envs.malls") / "walks.csv").read_text(encoding="utf-8")
    made = []
    for row in csv.DictReader(text.splitlines()):
        start_s, part = float(row["start_s"]), row["part"]
        end_s = start_s + float(row["duration_s"])
        of = int(part) if part.isdecimal() else part
        made.append(Walk(row["path"], row["session"], start_s, end_s, of, row["outing"]))
    return tuple(sorted(made, key=lambda walk: walk.path))


@functools.cache
def sessions() -> tuple[Session, ...]:
    """Every session of the set, by the time at which it began."""
    of_session: dict[str, list[Walk]] = {}
    for walk in sorted(walks(), key=lambda walk: walk.start_s):
        of_session.setdefault(walk.session, []).append(walk)
    return tuple(Session(tuple(of)) for of in of_session.values())


@functools.cache
def survey_of(part: str | int) -> tuple[Walk, ...]:
    """The walks whose scans are given to walks of "val", of "test", or of a fold of train, sorted by path.

    They are walks of other folds, recorded before `SURVEY_ENDS_S` and more than the guard from every session of `part`.
    """
    away = [session for session in sessions() if session.walks[0].part == part]
    kept = [
        session
        for session in sessions()
        if session.walks[0].split == "train" and session.walks[0].part != part and session.start_s < SURVEY_ENDS_S
        if not any(session.is_near(other) for other in away)
    ]
    return tuple(sorted((walk for session in kept for walk in session.walks), key=lambda walk: walk.path))


@functools.cache
def _played_before() -> frozenset[str]:
    """Names of the files, without suffix, of the walks that localizers were developed on."""
    rows = datasets()["ilc20"].files
    return frozenset(row.path.split("/")[-1].partition(".")[0] for row in rows if row.role in PLAYED_BEFORE)
