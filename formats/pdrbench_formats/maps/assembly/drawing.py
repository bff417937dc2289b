"""What is drawn on each level, and what has to be mended in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from pdrbench.errors import MapError
from pdrbench_formats.maps.plan import Repair

ConnectionKind = Literal["stairs", "escalator", "lift"]
ASSUMPTIONS: Final = frozenset({"height assumed", "units assumed", "treads made", "door found"})
"""Kinds of `Repair` that complete a drawing and mend nothing: strict mode allows them."""


class RepairLog:
    """Everything that is mended or assumed, in order; in strict mode the first thing to mend is an error."""

    def __init__(self, *, strict: bool) -> None:
        self._strict = strict
        self.entries: list[Repair] = []

    def add(
        self, kind: str, where: str, what: str, place: Sequence[float] | None = None, level: int | None = None
    ) -> None:
        """Notes one repair; `place` (x, y) in metres.

        Raises:
            MapError: In strict mode, of what is no assumption.
        """
        repair = Repair(kind, where, what, None if place is None else (float(place[0]), float(place[1])), level)
        if self._strict and kind not in ASSUMPTIONS:
            raise MapError(f"{where}: {what} ({kind}); mend the drawing, or read it without strict")
        self.entries.append(repair)


@dataclass(slots=True)
class Cell:
    """A part of a level before its edges are joined."""

    id: str
    shape: Any
    level: int
    kind: str = "floor"
    is_walled: bool = True  # whether its outline is a wall where no door is
    is_door: bool = False
    is_taken: bool = False  # by flights: it becomes no floor polygon of this level
    shaft: int = -1

    def is_open_to(self, other: Cell) -> bool:
        """Whether people pass an edge between the two."""
        is_in_shaft = self.shaft == other.shaft != -1
        return self.is_door or other.is_door or is_in_shaft or not (self.is_walled or other.is_walled)


@dataclass(slots=True)
class DrawnLevel:
    """What was drawn on a level."""

    number: int
    height_m: float
    walkable: list[Cell] = field(default_factory=list)
    walls: list[Any] = field(default_factory=list)
    doors: list[tuple[Any, float, str]] = field(default_factory=list)


@dataclass(slots=True)
class Connection:
    """Stairs, an escalator or a lift, with its outline on each level that it joins."""

    kind: str
    id: str
    outlines: dict[int, Any]
    is_walled: bool
    levels: tuple[int, ...]
    up: tuple[float, float] | None
