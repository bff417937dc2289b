"""Outings: walks of one place that follow one another, none of which is a survey of another.

A surveyor walks a building corridor by corridor, so that walks of one hour share the phone's state, the networks on the
air and often the very corridor. Walks that follow one another within ten minutes are an outing; one that lasts longer
than about twenty minutes is cut between walks into parts of about that length.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Final, Protocol, TypeVar

GUARD_S: Final = 600.0  # between two outings, and between the walks of an outing and every scan of their survey
OUTING_S: Final = 1200.0  # about how long a part of a long outing is


class Timed(Protocol):
    """What was recorded between two times on one clock, in seconds."""

    @property
    def start_s(self) -> float:
        """When it began."""

    @property
    def end_s(self) -> float:
        """When it ended."""


Walk = TypeVar("Walk", bound=Timed)


def is_near(one: Timed, other: Timed) -> bool:
    """True where less than the guard is between two walks."""
    return one.start_s <= other.end_s + GUARD_S and other.start_s <= one.end_s + GUARD_S


def parted(walks: Iterable[Walk]) -> Iterator[tuple[Walk, ...]]:
    """Outings of walks in order of time: parted where more than the guard, and cut where longer than a part."""
    together: list[list[Walk]] = []
    for walk in walks:
        if not together or not is_near(together[-1][-1], walk):
            together.append([])
        together[-1].append(walk)
    for outing in together:
        start_s, length_s = outing[0].start_s, outing[-1].end_s - outing[0].start_s
        num_parts = max(1, round(length_s / OUTING_S))
        parts: dict[int, list[Walk]] = defaultdict(list)
        for walk in outing:
            middle_s = (walk.start_s + walk.end_s) / 2 - start_s
            parts[min(num_parts - 1, int(middle_s / max(length_s, 1.0) * num_parts))].append(walk)
        yield from (tuple(part) for part in parts.values())


def surveyed(walks: Iterable[Walk]) -> Iterator[tuple[tuple[Walk, ...], list[Walk]]]:
    """Each outing of a place, with its survey: the walks that are more than the guard from every walk of it."""
    walks = sorted(walks, key=lambda walk: walk.start_s)
    for outing in parted(walks):
        yield outing, [walk for walk in walks if not any(is_near(walk, of) for of in outing)]
