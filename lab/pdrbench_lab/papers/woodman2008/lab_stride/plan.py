"""The parts of a laboratory building that all its levels share, and their sizes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from pdrbench_sim.buildings.assembly import Pose, Ring, Span
from pdrbench_sim.buildings.stairwell import StairParams, StairPlace, StairSize

TOP_LEVEL: Final = 2
ALL_LEVELS: Final = tuple(range(TOP_LEVEL + 1))


@dataclass(frozen=True, slots=True)
class LabParams:
    """Sizes of what a laboratory building is made of; pairs are ranges of a uniform draw. Ours unless a line says more.

    The thicknesses of walls and service strips and the depths of rooms are matched so that the floor touches 1.44 cubes
    of 1 m per square metre (sources.md, note 2).
    """

    street_m: tuple[float, float] = (3.2, 4.2)  # width of the main corridor that the wings start from
    void_fraction: float = 0.8  # of the spaces between wings have a void in the street above level 0
    gallery_m: float = 1.25  # floor left beside a void
    court_m: tuple[float, float] = (8.0, 11.0)  # between wings
    margin_m: tuple[float, float] = (0.4, 4.5)  # of the street beyond the last wing
    block_fraction: float = 0.35  # of the spaces between wings have rooms along the street
    corridor_m: tuple[float, float] = (1.5, 1.65)  # width in a wing
    strip_m: tuple[float, float] = (0.88, 0.98)  # risers and cupboards between the corridor of a wing and its rooms
    depth_m: tuple[float, float] = (2.7, 3.2)  # of rooms
    wall_m: float = 0.35  # between a wing, a room or a stairwell and the street; facades
    partition_m: tuple[float, float] = (0.20, 0.28)
    cupboard_m: tuple[float, float] = (0.75, 0.95)  # of a partition with ducts or cupboards in it
    cupboard_fraction: float = 0.7  # of partitions
    office_m: tuple[float, float] = (2.3, 3.0)  # width along the corridor
    meeting_m: tuple[float, float] = (3.8, 5.2)
    laboratory_m: tuple[float, float] = (5.6, 8.4)
    office_fraction: float = 0.76  # of the draws of a width
    meeting_fraction: float = 0.14
    door_m: float = 0.9
    two_doors_fraction: float = 0.6  # of laboratories have two doors
    side_door_fraction: float = 0.06  # of neighbours in a row have a door between them
    same_fraction: float = 0.6  # of rows repeat the level below
    twin_fraction: float = 0.7  # of other rows repeat the row of another wing
    change_fraction: float = 0.08  # of rooms that are repeated have another door, or are joined with the next
    unequal_fraction: float = 0.4  # of buildings have other wings on one side of the street than on the other
    length_ratio: tuple[float, float] = (0.8, 1.2)  # of their lengths
    short_fraction: float = 0.4  # of buildings have a shorter wing
    short_length: float = 0.7  # of the others
    low_fraction: float = 0.35  # of buildings have a wing without the highest level
    end_hall_fraction: float = 0.3  # of sides have a room across the end of each wing
    end_stairs_fraction: float = 0.8  # of buildings have wings with a stairwell at the end
    link_fraction: float = 0.5  # of buildings have a corridor along the far ends of the wings of one side
    hall_m: tuple[float, float] = (5.0, 7.5)  # depth of a room across the end of a corridor
    common_width_m: tuple[float, float] = (5.0, 14.0)  # of a room across the end of the street
    wide_door_m: float = 1.6
    theatre_width_m: tuple[float, float] = (10.5, 13.5)
    stage_m: tuple[float, float] = (2.8, 3.6)  # flat floor before the first row of a theatre
    row_m: tuple[float, float] = (0.85, 0.95)  # depth of a row of seats, two treads of its aisle
    row_riser_m: tuple[float, float] = (0.14, 0.155)  # of a tread of the aisle
    aisle_m: tuple[float, float] = (1.2, 1.5)
    level_height_m: tuple[float, float] = (3.8, 4.1)
    stairs: StairParams = field(default_factory=StairParams)


@dataclass(frozen=True, slots=True)
class Corridor:
    """A corridor or the street; `voids` are holes in it above level 0."""

    id: str
    ring: Ring
    top: int = TOP_LEVEL
    voids: tuple[Ring, ...] = ()


@dataclass(frozen=True, slots=True)
class Joint:
    """Where two corridors meet, without a door."""

    one: str
    other: str
    pose: Pose
    u: Span
    v_m: float
    top: int = TOP_LEVEL


@dataclass(frozen=True, slots=True)
class RoomRow:
    """Rooms side by side along a corridor."""

    id: str  # without the level
    corridor: str  # id of the corridor, without the level
    pose: Pose  # u runs along the corridor, v away from its edge, which is v = 0
    span: Span  # of the rooms along u
    gap_m: float  # thickness of what lies between corridor and rooms, and what doors pass through
    depth_m: float  # of the rooms
    stairs: Span | None = None  # part of the span that a stairwell takes, or None
    top: int = TOP_LEVEL  # highest level

    @property
    def shape(self) -> tuple[Span, float, Span | None]:
        """Rows of one shape may have the same rooms."""
        return self.span, self.depth_m, self.stairs


@dataclass(frozen=True, slots=True)
class Hall:
    """One room at the end of a corridor, wider than it."""

    id: str  # without the level
    use: str  # what it is there for
    corridor: str  # id of the corridor, without the level
    pose: Pose  # v = 0 is the end of the corridor, u = 0 its middle, v points out of it
    span: Span  # of the room along u
    gap_m: float  # thickness of the wall between
    depth_m: float  # of the room
    door_m: float  # width of the door
    levels: tuple[int, ...] = ALL_LEVELS  # where there is one


@dataclass(frozen=True, slots=True)
class Stairwell:
    """A stairwell along `corridor` behind a wall of thickness `gap_m`; v = 0 of its place is the inner face."""

    corridor: str
    place: StairPlace
    gap_m: float


@dataclass(frozen=True, slots=True)
class Theatre:
    """A lecture theatre: a hall on level 0 whose rows of seats rise away from the corridor."""

    hall: Hall  # its outline and door
    stage_m: float  # depth of the flat floor before the first row
    aisle: Span  # along u
    num_rows: int  # rows of seats
    row_m: float  # depth of one, two treads of the aisle
    riser_m: float  # height of a tread; a row is two higher than the one before it


@dataclass(slots=True)
class Plan:
    """What all levels share, as it comes about."""

    level_height_m: float  # from floor to floor
    stair: StairSize  # the same in every stairwell
    corridors: list[Corridor] = field(default_factory=list)  # the street, wings and links between them
    joints: list[Joint] = field(default_factory=list)  # where corridors meet
    rows: list[RoomRow] = field(default_factory=list)  # of rooms
    halls: list[Hall] = field(default_factory=list)  # rooms at the ends of corridors
    stairwells: list[Stairwell] = field(default_factory=list)  # each from the lowest to the highest level
    theatres: list[Theatre] = field(default_factory=list)  # one
    # Outline of the part of a wing of the highest level in which positions are scored; one.
    tracked: list[Ring] = field(default_factory=list)
    # Floor of each wing on all its levels, roughly: what grows with the length of the wings.
    wings_m2: list[float] = field(default_factory=list)
