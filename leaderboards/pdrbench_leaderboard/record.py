"""What is kept of a board: its walks, and of each entry a card, answers at scored moments and scores of walks.

`<board>/walks.json` says which walks there are, `<board>/<entry>/entry.json` how an entry did on each, `answers.bin`
what it answered, one block for each part and division.
"""

from __future__ import annotations

import datetime
import hashlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np

from pdrbench.errors import BundleError
from pdrbench.evaluation.store import make_folder, write_whole
from pdrbench.files import sha256_of
from pdrbench.geometry import FloatArray
from pdrbench.registry import localizers
from pdrbench.settings import split_name
from pdrbench_leaderboard.boards import PRIVATE, Part, find_round
from pdrbench_leaderboard.canaries import CanaryRecord
from pdrbench_leaderboard.card import CARD_FILE, Card, card_toml, read_card
from pdrbench_leaderboard.draw import DrawnPart, read_truth, walks_sha256
from pdrbench_leaderboard.schema import Count, EntryName, Line, Name, Record, Remark, Sha256, read_json, read_limited
from pdrbench_leaderboard.score import DIGITS, QUANTILES, VALUES, ScoredPart
from pdrbench_leaderboard.signing import KEYS_FILE, read_keys, sign, signed_text

ENTRY_FILE, ANSWERS_FILE, WALKS_FILE, SIGNATURE_FILE = "entry.json", "answers.bin", "walks.json", "signed.json"
MAX_FILE_BYTES: Final = 64_000_000
INFINITE: Final = 1e9  # JSON has no infinite numbers

Number = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]


class Walk(Record, frozen=True, array_like=True):
    """One walk of a board: what is public of it."""

    name: Name
    unit: str  # of replication, as a digest
    groups: tuple[str, ...]  # strata
    duration_s: Number
    moments: Count  # that are scored


class PartWalks(Record, frozen=True, kw_only=True):
    """The walks of one part of an environment."""

    env: Name
    part: Part
    round: int
    made_by: Sha256  # versions of what drew them
    sha256: Sha256  # see `draw.walks_sha256`
    walks: tuple[Walk, ...]
    declined: dict[EntryName, Sha256]  # code by entry that every walk did not suit


class DivisionRecord(Record, frozen=True, kw_only=True):
    """What came of an entry on one part of an environment, in one division; see `score.ScoredPart`."""

    division: Literal["online", "offline"]
    statuses: Annotated[str, msgspec.Meta(pattern=r"^[cfd]{0,5000}\Z")]
    failures: dict[str, Count]
    values: dict[Name, tuple[Number | None, ...]]
    moments: Count
    quantiles_m: tuple[Number, ...]
    begin: Count  # of its block in `answers.bin`


class PartRecord(Record, frozen=True, kw_only=True):
    """How an entry did on one part of an environment."""

    env: Name
    part: Part
    round: int
    walks_sha256: Sha256  # that of `PartWalks`
    localizer_sha256: Sha256  # of the code that played
    versions: dict[Name, Remark]
    machine: dict[Name, Remark | int]
    isolation: dict[str, Any]
    divisions: tuple[DivisionRecord, ...]
    canaries: CanaryRecord | None = None

    @property
    def place(self) -> tuple[str, Part]:
        """Environment and part."""
        return self.env, self.part


class EntryRecord(Record, frozen=True, kw_only=True):
    """An entry of a board."""

    board: Name
    name: EntryName  # as its card says
    spec: Line  # what was played: a registered id, or what lies in the folder of the entry
    answers_sha256: Sha256
    parts: tuple[PartRecord, ...]


def part_walks(drawn: DrawnPart, round_number: int) -> PartWalks:
    """What is public of drawn walks; units are named by digests."""
    index = drawn.index
    walks = []
    for name in drawn.walks:
        truth = read_truth(drawn, name)
        unit = hashlib.sha256(f"{index.nonce}/{truth.unit}".encode()).hexdigest()[:8]
        walks.append(Walk(name, unit, truth.groups, round(truth.duration_s, 1), len(truth.reference)))
    return PartWalks(
        env=drawn.env,
        part=drawn.part,
        round=round_number,
        made_by=drawn.made_by,
        sha256=walks_sha256(index),
        walks=tuple(walks),
        declined={},
    )


def all_walks(folder: Path) -> dict[tuple[str, Part], list[PartWalks]]:
    """Walks of a board by environment and part, those drawn last at the end; raises `BundleError`.

    There are two where walks were drawn anew and some entry has not played them: until then the older ones rank.
    """
    path, found = folder / WALKS_FILE, dict[tuple[str, Part], list[PartWalks]]()
    if path.is_file():
        for of in read_json(read_limited(path, MAX_FILE_BYTES), tuple[PartWalks, ...], str(path)):
            found.setdefault((of.env, of.part), []).append(of)
    return found


def read_walks(folder: Path) -> dict[tuple[str, Part], PartWalks]:
    """Walks of a board that rank, by environment and part; none where nothing was played. Raises `BundleError`."""
    return {place: _ranking(folder, drawn)[0] for place, drawn in all_walks(folder).items()}


def write_walks(folder: Path, now: PartWalks) -> None:
    """Adds walks to those of a board, in place of older ones which nothing ranks on any more."""
    make_folder(folder)
    walks = all_walks(folder)
    drawn = walks.setdefault((now.env, now.part), [])
    drawn[:] = _ranking(folder, [*(of for of in drawn if of.sha256 != now.sha256), now])
    write_whole(folder / WALKS_FILE, _lines([of for place in sorted(walks) for of in walks[place]]))


def _ranking(folder: Path, drawn: list[PartWalks]) -> list[PartWalks]:
    """From the walks that rank on: the newest that every entry has played which has played older ones."""
    while len(drawn) > 1 and _players(folder, drawn[0]) <= _players(folder, drawn[1]) | drawn[1].declined.keys():
        drawn = drawn[1:]
    return drawn


def _players(folder: Path, walks: PartWalks) -> set[str]:
    """Entries that have played these walks."""
    found = set()
    for entry in list_entries(folder.parent, folder.name):
        record = read_json(read_limited(entry / ENTRY_FILE, MAX_FILE_BYTES), EntryRecord, str(entry))
        if any(of.walks_sha256 == walks.sha256 and of.place == (walks.env, walks.part) for of in record.parts):
            found.add(record.name)
    return found


def part_record(
    walks: PartWalks,
    scored: Sequence[ScoredPart],
    localizer_sha256: str,
    provenance: Mapping[str, Any],
    canaries: CanaryRecord | None = None,
) -> tuple[PartRecord, bytes]:
    """What is kept of a part in all divisions, and the packed answers.

    Args:
        walks: That were played.
        scored: Of each division.
        localizer_sha256: Of the code that played.
        provenance: Of one of its results.
        canaries: What they showed.
    """
    divisions, content = [], b""
    for one in scored:
        divisions.append(
            DivisionRecord(
                division=one.division,  # type: ignore[arg-type]
                statuses=one.statuses,
                failures=dict(one.failures),
                values={name: tuple(map(_rounded, values.tolist())) for name, values in one.values.items()},
                moments=one.moments,
                quantiles_m=tuple(_rounded(value) or 0.0 for value in one.quantiles_m.tolist()),
                begin=len(content),
            )
        )
        content += b"" if walks.part == PRIVATE else one.answers  # good ones are nearly the truth
    record = PartRecord(
        env=walks.env,
        part=walks.part,
        round=walks.round,
        walks_sha256=walks.sha256,
        localizer_sha256=localizer_sha256,
        versions=dict(provenance["versions"]),
        machine=dict(provenance.get("machine", {})),
        isolation=dict(provenance.get("isolation", {})),
        divisions=tuple(divisions),
        canaries=canaries,
    )
    return record, content


def numbers(values: Sequence[float | None]) -> FloatArray:
    """(W,) what JSON holds as numbers again: NaN for none, infinite for a time that never came."""
    array = np.array([math.nan if value is None else value for value in values])
    return np.where(array >= INFINITE, math.inf, array)


def read_entry(folder: Path) -> tuple[EntryRecord, Card]:
    """An entry and its card; raises `BundleError` where they are no such files, or the answers are others."""
    path = folder / ENTRY_FILE
    record = read_json(read_limited(path, MAX_FILE_BYTES), EntryRecord, str(path))
    card = read_card(read_limited(folder / CARD_FILE, MAX_FILE_BYTES), str(folder / CARD_FILE))
    content = read_answers(folder)
    if hashlib.sha256(content).hexdigest() != record.answers_sha256:
        raise BundleError(f"{folder / ANSWERS_FILE} is not the one that {ENTRY_FILE} was written with")
    for of in (of for part in record.parts for of in part.divisions):
        more = of.values.keys() - {*VALUES}  # the metric of a board that ranks by another
        is_whole = of.values.keys() >= {*VALUES} and len(of.quantiles_m) in (0, len(QUANTILES))
        if not is_whole or len(more) > 1 or {*map(len, of.values.values())} != {len(of.statuses)}:
            raise BundleError(f"{path} has not one value of each metric for each walk")
    if (record.board, folder_name(record.name)) != (folder.parent.name, folder.name) or card.name != record.name:
        raise BundleError(f"{folder} holds {record.name} of the board {record.board}: it lies in <board>/<entry>/")
    return record, card


def read_answers(folder: Path) -> bytes:
    """The packed answers of an entry."""
    return read_limited(folder / ANSWERS_FILE, MAX_FILE_BYTES)


def write_entry(
    root: Path, board: str, spec: str, card: Card, parts: Sequence[tuple[PartRecord, bytes]]
) -> tuple[EntryRecord, Path]:
    """Writes an entry below a folder of boards, in place of what lay there.

    Args:
        root: Holds the boards.
        board: Name of the board.
        spec: What was played.
        card: Of its authors.
        parts: What is kept of each, and its packed answers.
    """
    moved, content = [], b""
    for part, answers in parts:
        first = min((of.begin for of in part.divisions), default=0)
        divisions = tuple(msgspec.structs.replace(of, begin=of.begin - first + len(content)) for of in part.divisions)
        moved.append(msgspec.structs.replace(part, divisions=divisions))
        content += answers
    record = EntryRecord(
        board=board, name=card.name, spec=spec, answers_sha256=hashlib.sha256(content).hexdigest(), parts=tuple(moved)
    )
    folder = make_folder(root / board / folder_name(card.name))
    (folder / SIGNATURE_FILE).unlink(missing_ok=True)  # it was of what lay here before
    write_whole(folder / ANSWERS_FILE, content)
    write_whole(folder / CARD_FILE, card_toml(card))
    write_whole(folder / ENTRY_FILE, _lines(record))
    return record, folder


def answers_of(record: EntryRecord, content: bytes, part: PartRecord) -> bytes:
    """The packed answers of one part of an entry, in all its divisions."""
    ends = sorted({of.begin for other in record.parts for of in other.divisions} | {len(content)})
    begins = [] if part.part == PRIVATE else [of.begin for of in part.divisions]
    return content[min(begins) : next(end for end in ends if end > max(begins))] if begins else b""


def folder_name(entry: str) -> str:
    """The folder of an entry: its name, with the mark before settings as every file system takes it.

    >>> folder_name("li2012?map=false")
    'li2012@map=false'
    """
    return entry.replace("?", "@")


class Verification(Record, frozen=True, kw_only=True):
    """What a maintainer signs: that this entry is what came of a run by a maintainer, and its card the one sent."""

    board: Name
    name: EntryName
    entry_sha256: Sha256  # of `entry.json`, which holds the digest of the answers
    card_sha256: Sha256  # of `card.toml`
    date: datetime.date


def sign_entry(folder: Path, key: Path) -> None:
    """Signs an entry; raises `BundleError`."""
    record, _ = read_entry(folder)
    found = Verification(
        board=record.board,
        name=record.name,
        entry_sha256=sha256_of(folder / ENTRY_FILE),
        card_sha256=sha256_of(folder / CARD_FILE),
        date=datetime.datetime.now(datetime.UTC).date(),
    )
    write_whole(folder / SIGNATURE_FILE, sign(found, key))


def is_verified(folder: Path, record: EntryRecord) -> bool:
    """Whether an entry ranks: a maintainer has signed it, or anybody can play the rounds that it is of.

    What is not registered here needs a signature all the same where the folder of boards lists keys.

    Raises:
        BundleError: It is signed, and with no listed key, or by one that was revoked, or it is another entry by now.
    """
    path = folder / SIGNATURE_FILE
    if not path.is_file():
        is_registered = split_name(record.spec)[0] in localizers() and record.spec == record.name
        is_free = is_registered or not (folder.parents[1] / KEYS_FILE).is_file()
        return (
            is_free
            and not held(record)
            and all(find_round(part.round, folder.parents[1]).secret for part in record.parts)
        )
    keys = read_keys(folder.parents[1])
    body, key = signed_text(read_limited(path, MAX_FILE_BYTES), keys, str(path))
    found = read_json(body.encode(), Verification, str(path))
    signed = (found.board, found.name, found.entry_sha256, found.card_sha256)
    if signed != (record.board, record.name, sha256_of(folder / ENTRY_FILE), sha256_of(folder / CARD_FILE)):
        raise BundleError(f"{path} is of another entry, or of this one before it was changed")
    if found.date < key.since:
        raise BundleError(f"{path} is of {found.date}, its key is valid from {key.since}")
    return True


def held(record: EntryRecord) -> str:
    """Why a person has to look at an entry before it ranks, and sign it; empty where none has to."""
    return next((of.canaries.held for of in record.parts if of.canaries is not None and of.canaries.held), "")


def list_entries(root: Path, board: str) -> list[Path]:
    """Folders of a board that hold an entry, by name."""
    return sorted(path.parent for path in (root / board).glob(f"*/{ENTRY_FILE}"))


def _rounded(value: float) -> float | None:
    if math.isnan(value):
        return None
    return float(f"{min(value, INFINITE):.{DIGITS}g}")


def _lines(record: object) -> bytes:
    """JSON, the same bytes for the same record; long lists on one line each."""
    plain = msgspec.json.decode(msgspec.json.encode(record, order="deterministic"))
    return (_text(plain) + "\n").encode()


def _text(value: Any, indent: str = "") -> str:
    inner = f"{indent} "
    if isinstance(value, dict) and value:
        items = [f"{inner}{_plain(key)}: {_text(of, inner)}" for key, of in value.items()]
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    if isinstance(value, list) and value and isinstance(value[0], (dict, list)):
        items = [f"{inner}{_text(of, inner) if isinstance(of, dict) else _plain(of)}" for of in value]
        return "[\n" + ",\n".join(items) + f"\n{indent}]"
    return _plain(value)


def _plain(value: Any) -> str:
    return msgspec.json.encode(value).decode()
