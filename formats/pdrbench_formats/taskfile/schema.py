"""What stands in a `task.toml`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from pdrbench.errors import PdrbenchError
from pdrbench.task import StartKnowledge
from pdrbench_formats.toml import read_toml

_LARGEST = 1e12  # of any number: TOML has inf and nan
_Number = Annotated[float, msgspec.Meta(ge=-_LARGEST, le=_LARGEST)]
_Positive = Annotated[float, msgspec.Meta(gt=0, le=_LARGEST)]
_Name = Annotated[str, msgspec.Meta(min_length=1, pattern=r"^[^\x00]*$")]


class TaskTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """`[task]`.

    Attributes:
        id: `Name-v0`; made of the name of the folder where it is left out.
        summary: One sentence for tables.
        description: Markdown.
        licence, source: Of the recordings.
        start: What a localizer is given of the start; None: "pose" where every walk has a start or a first place.
        period_s: Between observations.
        sensors: Offered; None for all that a walk has.
        rates_hz: Nominal rate by sensor; left out: the median over walks.
        derive: Whether sensors that are missing are computed from others.
        unit_kind: What the `unit` of a walk is, for tables: "session", "person".
    """

    id: str = ""
    summary: str = ""
    description: str = ""
    licence: str = ""
    source: str = ""
    start: StartKnowledge | None = None
    period_s: _Positive = 0.2
    sensors: tuple[_Name, ...] | None = None
    rates_hz: Mapping[str, _Positive] = {}
    derive: bool = True
    unit_kind: _Name = "session"


class AlignTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """`[plan.align]`: where a plan lies that does not say so itself.

    Attributes:
        lat_deg, lon_deg: Of the origin of the plan.
        turn_deg: Heading of the x axis of the plan, counter-clockwise from east.
        scale: Metres per unit of the plan.
    """

    lat_deg: _Number | None = None
    lon_deg: _Number | None = None
    turn_deg: _Number = 0.0
    scale: _Positive = 1.0


class PlanTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """`[plan]`: file, relative to the folder of the task, its format where the content does not show it.

    `doors` says what is done for rooms without one: "none", "rooms", "nearest" or "wide".
    """

    file: _Name
    format: str = ""
    doors: str = "none"
    align: AlignTable | None = None


class StartTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """`start` of a walk.

    Attributes:
        xy_m: In metres of the plan; None for the first place of the walk, and its level.
        level: IMDF ordinal, 0 ground.
        heading_deg: Heading of travel, counter-clockwise from the x axis of the plan (east).
        radius_m: How far off it may be.
    """

    xy_m: tuple[_Number, _Number] | None = None
    level: int = 0
    heading_deg: _Number | None = None
    radius_m: Annotated[float, msgspec.Meta(ge=0)] = 0.0

    @property
    def heading_rad(self) -> float | None:
        """None where it is not known."""
        return None if self.heading_deg is None else math.radians(self.heading_deg)

    @classmethod
    def of_text(cls, text: str) -> StartTable:
        """What follows `--start`: `x,y,level,heading`, of which level and heading may be left out.

        Raises:
            PdrbenchError: Numbers are missing or cannot be meant.
        """
        try:
            x_m, y_m, *others = (float(part) for part in text.split(","))
            level, heading_deg = others[0] if others else 0.0, others[1] if len(others) > 1 else None
            if len(others) > 2 or level != int(level) or not all(map(math.isfinite, (x_m, y_m, heading_deg or 0.0))):
                raise ValueError
        except (ValueError, OverflowError):
            raise PdrbenchError(
                f"--start is x,y,level,heading in metres and degrees, as in 3.2,7.5,0,90; got {text!r}"
            ) from None
        return cls(xy_m=(x_m, y_m), level=int(level), heading_deg=heading_deg)


class WalkTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """`[[walk]]`.

    Attributes:
        file: Recording, relative to the folder of the task.
        split: It belongs to.
        id: Name of the walk; that of the file where it is left out.
        format: Of the file where its content does not show it.
        start: Where it begins; None for its first place.
        mounting: Where the device was carried: "hand", "pocket", "foot".
        subject: Facts on the person, such as `height_m`.
        truth: CSV of places, instead of those of the recording.
        truth_offset_s: What is added to the times of `truth`, whose clock is another.
        columns: Column map of this table, or a file with one; None for that of the task.
        unit: Recording session or person. Intervals resample units, and a fold holds whole ones; every walk has one, or
            none has and the building is the unit.
        group: Results are also shown by group, as "unseen floor".
    """

    file: _Name
    split: Literal["train", "val", "test"] = "test"
    id: str = ""
    format: str = ""
    start: StartTable | None = None
    mounting: str = ""
    subject: Mapping[str, float | str] = {}
    truth: str = ""
    truth_offset_s: float = 0.0
    columns: str | Mapping[str, Any] | None = None
    unit: str = ""
    group: str = ""


class SurveyTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """`[survey]`: what the radio map is made of.

    Attributes:
        walks: Ids of walks of the task, whose scans count at their places.
        file: Tables of readings at places, see `pdrbench_formats.taskfile.survey`, and recordings with places, or
            folders of them. No walk is given scans of its own outing.
    """

    walks: tuple[_Name, ...] = ()
    file: _Name | tuple[_Name, ...] = ()

    @property
    def files(self) -> tuple[str, ...]:
        """The files, also where one is named."""
        return (self.file,) if isinstance(self.file, str) else self.file


def _answer(question: str) -> msgspec.Meta:
    return msgspec.Meta(min_length=1, description=question)


class CardTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """`[card]`: what others need to know of recordings of people before they use them, and whom to ask."""

    who: Annotated[str, _answer("how many people walked, of which age or height; no names")]
    where: Annotated[str, _answer("kind of building, town or country")]
    how: Annotated[str, _answer("how the walks were made, and how the places were surveyed")]
    device: Annotated[str, _answer("phones or units, and the app")]
    licence: Annotated[str, _answer("under which others may use it, such as CC-BY-4.0")]
    consent: Annotated[str, _answer("what the people agreed to")]
    contact: str = ""


class TaskFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """The whole file. `columns` is the column map of all tables that have none of their own, or a file with it."""

    task: TaskTable = TaskTable()
    plan: PlanTable | None = None
    columns: str | Mapping[str, Any] | None = None
    walk: tuple[WalkTable, ...] = ()
    survey: SurveyTable | None = None
    card: CardTable | None = None

    @property
    def named(self) -> list[str]:
        """Every file that it names."""
        maps = [self.columns, *(table.columns for table in self.walk)]
        names = [name for table in self.walk for name in (table.file, table.truth)]
        names += [] if self.plan is None else [self.plan.file]
        names += [] if self.survey is None else self.survey.files
        return [name for name in (*names, *(of for of in maps if isinstance(of, str))) if name]


def read_task_file(path: Path) -> TaskFile:
    """Reads a `task.toml`.

    Raises:
        RecordingError: Names the file, the key that is unknown or wrong, and the nearest known key.
    """
    return read_toml(path, TaskFile, "Bring your own")
