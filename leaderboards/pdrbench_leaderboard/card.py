"""`card.toml`: who made a localizer, from what, and what it uses, as stated by those who submit it."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec

from pdrbench.errors import BundleError
from pdrbench.localizer_folder import PACKAGES_MARK
from pdrbench.registry import CARDS_FILE, localizers
from pdrbench.settings import join_name, split_name
from pdrbench_leaderboard.schema import EntryName, Line, Name, Passage, Remark, read_toml

CARD_FILE: Final = "card.toml"
TEMPLATE_FILE: Final = "card_template.toml"  # a card to fill in
DEFAULTS: Final = "defaults"  # table of that file with what its cards have in common

Url = Annotated[str, msgspec.Meta(pattern=r"^(https?://[^\s<>\"']{1,300})?\Z")]


class Card(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a table shows beside the scores.

    Attributes:
        name: Id under which the leaderboards list it, such as "mine".
        authors: Names.
        licence: SPDX expression or name of the licence of the code.
        sensors_used: Names of the sensors it reads where an environment offers them.
        map_used: Whether it uses the building.
        survey_used: Whether it uses the radio survey.
        training_data: What anything in it was learned or tuned on; "none" where nothing was.
        contact: How to reach the authors.
        paper: Citation.
        url: Of the code or the paper, http or https.
        notes: Anything else that a reader of the table should know.
    """

    name: EntryName
    authors: Annotated[tuple[Line, ...], msgspec.Meta(min_length=1, max_length=50)]
    licence: Line
    sensors_used: Annotated[tuple[Name, ...], msgspec.Meta(max_length=50)]
    map_used: bool
    survey_used: bool
    training_data: Annotated[Passage, msgspec.Meta(min_length=1)]
    contact: Remark = ""
    paper: Annotated[str, msgspec.Meta(max_length=1000)] = ""
    url: Url = ""
    notes: Passage = ""


# What each field has to be.
FIELDS: Final = {
    "name": 'lower-case letters, digits, "_" and "-", as in "mine"',
    "authors": 'a list of names, as in ["A. Author"]',
    "licence": 'text in quotes, as in "MIT"',
    "sensors_used": 'a list of names of sensors, as in ["accel", "gyro"]; [] for none',
    "map_used": "true or false, without quotes",
    "survey_used": "true or false, without quotes",
    "training_data": 'text in quotes, up to 4000 characters; "none" where nothing was learned',
    "contact": "text in quotes, up to 400 characters",
    "paper": "text in quotes, up to 1000 characters",
    "url": "an address in quotes that begins with http:// or https://",
    "notes": "text in quotes, up to 4000 characters",
}


def read_card(content: bytes, what: str = CARD_FILE) -> Card:
    """A card from TOML.

    Raises:
        BundleError: It is no TOML; or fields are missing, unknown or wrong: names every one.
    """
    return _card(read_toml(content, dict[str, Any], what), what)


def _card(fields: Mapping[str, Any], what: str) -> Card:
    """The card of these fields; raises `BundleError` that names every fault."""
    faults = []
    for name in fields:
        if name not in FIELDS:
            near = difflib.get_close_matches(name, FIELDS, n=1)
            faults.append(f"{name!r:.80} is no field of a card{f', did you mean {near[0]!r}?' if near else ''}")
    for field in msgspec.structs.fields(Card):
        if field.name not in fields:
            faults += [f"{field.name} is missing: {FIELDS[field.name]}"] if field.required else []
            continue
        try:
            msgspec.convert(fields[field.name], field.type)
        except (msgspec.ValidationError, RecursionError):
            shown = " ".join(f"{fields[field.name]!r:.80}".split())
            faults.append(f"{field.name} = {shown} is wrong: {FIELDS[field.name]}")
    if faults:
        raise BundleError(f"{what}: {'; '.join(faults)}")
    return msgspec.convert(fields, Card)


def card_toml(card: Card) -> bytes:
    """A card as TOML, with every field."""
    lines = [f"{name} = {_toml(value)}" for name, value in msgspec.structs.asdict(card).items()]
    return ("\n".join(lines) + "\n").encode()


def card_of(localizer: str) -> Card:
    """The card of a registered localizer, from `cards.toml` in the package that registers it.

    The table "defaults" of that file holds what its cards have in common.

    Raises:
        BundleError: The localizer is not registered or its package has no card of it.
    """
    plain, settings = split_name(localizer)
    entry = localizers().get(plain)
    if entry is None:
        raise BundleError(f"{localizer} needs a card: write one with `pdrbench submit card {localizer} > card.toml`")
    if entry.folder is None or not (path := entry.folder / CARDS_FILE).is_file():
        raise BundleError(f"{entry.package} has no {CARDS_FILE} in its package: name a card with --card")
    try:
        cards: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
        fields = cards.get(DEFAULTS, {}) | {"name": plain} | cards[plain]
        fields["name"] = join_name(fields["name"], settings)
    except KeyError:
        raise BundleError(f"{path} has no table [{plain}]") from None
    except (ValueError, TypeError) as error:
        raise BundleError(f"{path}, [{localizer}]: {error}") from None
    return _card(fields, f"{path}, [{localizer}]")


def template(localizer: str) -> str:
    """A card to fill in, for `package.module:Class`, `path/to/file.py:Class` or `path/to/folder`.

    >>> template("my_localizer.py:Mine").splitlines()[0]
    'name = "mine"  # under which the leaderboards list it'
    >>> template("path/to/stridenet@packages").splitlines()[0]
    'name = "stridenet"  # under which the leaderboards list it'
    """
    attribute = Path(localizer.rpartition(":")[2].partition(PACKAGES_MARK)[0]).name
    name = re.sub(r"[^a-z0-9_]+", "-", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", attribute).lower()).strip("-_")
    text = Path(__file__).with_name(TEMPLATE_FILE).read_text(encoding="utf-8")
    return text.format(name=name or "mine")


def _toml(value: str | bool | tuple[str, ...]) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, bool):
        return str(value).lower()
    return f"[{', '.join(_toml(item) for item in value)}]"
