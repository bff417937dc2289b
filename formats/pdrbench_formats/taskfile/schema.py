"""What stands in a `task.toml`."""

from __future__ import annotations

import difflib
import math
import re
import types
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec

from pdrbench.errors import RecordingError
from pdrbench.task import StartKnowledge
from pdrbench_formats.recordings.columnmap import toml_value

MAX_FILE_BYTES: Final = 1 << 20
_Positive = Annotated[float, msgspec.Meta(gt=0)]
_Name = Annotated[str, msgspec.Meta(min_length=1)]
_UNKNOWN: Final = re.compile(r"unknown field `(?P<key>.*?)`(?: - at `(?P<where>.*)`)?")
_ROW: Final = re.compile(r"\[(\d+)\]")
_NUMBER: Final = re.compile(r" \(number \d+\)")


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

    lat_deg: float | None = None
    lon_deg: float | None = None
    turn_deg: float = 0.0
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

    xy_m: tuple[float, float] | None = None
    level: int = 0
    heading_deg: float | None = None
    radius_m: Annotated[float, msgspec.Meta(ge=0)] = 0.0

    @property
    def heading_rad(self) -> float | None:
        """None where it is not known."""
        return None if self.heading_deg is None else math.radians(self.heading_deg)


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


class CardTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """`[card]`: what others need to know of recordings of people before they use them.

    Attributes:
        who: Walked: how many people, and of which age or height as far as that matters; no names.
        where: Kind of building, town or country.
        how: How the walks were made, and how the places were surveyed.
        device: Phones or units, and the app.
        licence: Under which others may use it.
        consent: What the people agreed to.
        contact: Whom to ask.
    """

    who: _Name
    where: _Name
    how: _Name
    device: _Name
    licence: _Name
    consent: _Name
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
    try:
        with path.open("rb") as stream:
            content = stream.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}; check the path") from error
    if len(content) > MAX_FILE_BYTES:
        raise RecordingError(f"{path}: larger than {MAX_FILE_BYTES} bytes; recordings belong into files of their own")
    try:
        return msgspec.toml.decode(content.removeprefix(b"\xef\xbb\xbf"), type=TaskFile)
    except msgspec.ValidationError as error:
        raise RecordingError(f"{path}: {_explained(str(error))}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: not TOML: {error}; put texts into quotes") from error


def _explained(message: str) -> str:
    """A message of msgspec; where a key is unknown, with the nearest one that is known."""
    message = _ROW.sub(lambda row: f" (number {int(row[1]) + 1})", message.replace("$.", ""))
    found = _UNKNOWN.search(message)
    if found is None:
        return f'{message}; see the page "Bring your own" of the documentation'
    where = found["where"] or ""
    known = _keys(_NUMBER.sub("", where))
    near = difflib.get_close_matches(found["key"], known, n=1, cutoff=0.5)
    remedy = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
    return f"no key {found['key']!r} in {f'[{where}]' if where else 'the file'}; {remedy}"


def _keys(where: str) -> tuple[str, ...]:
    """Keys of a table, from the path to it: `walk.start`."""
    table: Any = TaskFile
    for name in filter(None, where.split(".")):
        table = _struct_in(typing.get_type_hints(table)[name])
    keys: tuple[str, ...] = table.__struct_fields__
    return keys


def _struct_in(hint: Any) -> Any:
    """The table behind a type such as `StartTable | None` or `tuple[WalkTable, ...]`."""
    if isinstance(hint, type) and not isinstance(hint, types.GenericAlias) and issubclass(hint, msgspec.Struct):
        return hint
    return next(filter(None, map(_struct_in, typing.get_args(hint))), None)


def as_toml(content: TaskFile) -> str:
    """A task file as text; what has its default is left out."""
    plain = msgspec.to_builtins(content)
    lines: list[str] = []
    _add_table(lines, "", plain)
    return "\n".join(lines).strip() + "\n"


def _add_table(lines: list[str], name: str, table: Mapping[str, Any]) -> None:
    """Adds `[name]`, its values, then the tables and lists of tables in it; tables in walks stand in one line."""
    inner = {k: v for k, v in table.items() if isinstance(v, Mapping) and not name.startswith("[")}
    lists = {k: v for k, v in table.items() if isinstance(v, (list, tuple)) and v and isinstance(v[0], Mapping)}
    values = {k: v for k, v in table.items() if k not in inner and k not in lists}
    if name and (values or not inner):
        lines += ["", f"[{name}]"]
    lines += [f"{key} = {toml_value(value)}" for key, value in values.items()]
    for key, value in inner.items():
        _add_table(lines, f"{name}.{key}" if name else key, value)
    for key, rows in lists.items():
        for row in rows:
            _add_table(lines, f"[{key}]", row)
