"""How many walks and seeds an environment is played with by default: those of its leaderboard."""

from __future__ import annotations

from dataclasses import dataclass

from pdrbench.registry import PROTOCOLS_GROUP, entries

TRIED_WALKS = 4  # of an environment; a localizer that declines them all declines it; every mounting is among them
PROBED_WALKS = 2  # of an environment are run with two seeds, to see whether they matter


@dataclass(frozen=True, slots=True)
class Protocol:
    """What is played of a split.

    Attributes:
        walks: The first so many; None for all.
        seeds: Of every walk, by a localizer that draws random numbers.
    """

    walks: int | None = None
    seeds: int = 5


def protocol_of(env: str, split: str) -> Protocol:
    """The protocol of the leaderboard of an environment, else all walks; only test splits have leaderboards.

    A package states protocols by a function of the entry-point group `pdrbench.protocols`: given the id of an
    environment, it returns walks and seeds, or None.
    """
    for entry in entries(PROTOCOLS_GROUP).values() if split == "test" else ():
        if (stated := entry.load()(env)) is not None:
            return Protocol(*stated)
    return Protocol()
