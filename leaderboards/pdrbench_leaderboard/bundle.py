"""`.pdrz`: a submission as one file, a zip whose members are stored as they are.

`manifest.json`, `card.toml`, and `source/<file>` where code travels with it. Nothing in the zip is compressed, so that
nothing can swell when read.
"""

from __future__ import annotations

import hashlib
import io
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import msgspec

from pdrbench.errors import BundleError
from pdrbench.files import SAFE_PATH
from pdrbench_leaderboard.card import CARD_FILE, Card, card_toml, read_card
from pdrbench_leaderboard.schema import UNREADABLE, Line, Name, Record, Sha256, read_json, write_json

SCHEMA: Final = 4
SUFFIX: Final = ".pdrz"
MANIFEST_FILE: Final = "manifest.json"
SOURCE: Final = "source/"
MAX_BUNDLE_BYTES: Final = 256_000_000
MAX_MEMBERS: Final = 20_000
MAX_TEXT_BYTES: Final = 32_000_000  # of the manifest
MAX_SOURCE_BYTES: Final = 64_000_000  # of a folder with its weights
MAX_NAME_CHARACTERS: Final = 300
MEMBER: Final = re.compile(rf"{SAFE_PATH}\Z")
FIXED_TIME: Final = (1980, 1, 1, 0, 0, 0)  # the first that a zip can hold
UNIX: Final = 3
PLAIN_FILE: Final = 0o100644
FILE_KIND: Final = 0o170000
LOCAL_HEADER_BYTES: Final = 30
ENCRYPTED: Final = 0x1


class Manifest(Record, frozen=True, kw_only=True):
    """What a bundle says of itself."""

    schema: Literal[4]  # version of this format
    # What is played: a registered id, `file.py:Class` of a file in `source`, or the archive of a folder there
    spec: Line
    card_sha256: Sha256  # of `card.toml`
    source: Annotated[dict[Name, Sha256], msgspec.Meta(max_length=20)]  # digests by name of what travels with it


@dataclass(frozen=True, slots=True)
class Bundle:
    """A submission: code and a card."""

    spec: str  # as in `Manifest`
    card: Card  # what its authors say of it
    source: Mapping[str, bytes]  # content by name of the files that travel with it


def write_bundle(bundle: Bundle) -> bytes:
    """The bytes of a bundle: the same for the same submission."""
    card = card_toml(bundle.card)
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in sorted(bundle.source.items())}
    manifest = Manifest(schema=SCHEMA, spec=bundle.spec, card_sha256=hashlib.sha256(card).hexdigest(), source=digests)
    members = {MANIFEST_FILE: write_json(manifest), CARD_FILE: card}
    members |= {SOURCE + name: content for name, content in sorted(bundle.source.items())}
    return write_members(members)


def write_members(members: Mapping[str, bytes]) -> bytes:
    """A zip of stored files: the same bytes for the same members."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_STORED) as file:
        for name, content in members.items():
            info = zipfile.ZipInfo(name, FIXED_TIME)
            info.create_system, info.external_attr = UNIX, PLAIN_FILE << 16
            file.writestr(info, content)
    return archive.getvalue()


def read_bundle(content: bytes) -> Bundle:
    """The bundle in the bytes of an untrusted file: nothing of it is executed, written or looked up.

    Raises:
        BundleError: It is no bundle, was changed since it was packed, or is larger than one can be.
    """
    members = read_members(content)
    for name in (MANIFEST_FILE, CARD_FILE):
        if name not in members:
            raise BundleError(f"the bundle lacks {name}; `pdrbench submit pack` writes it")
        if len(members[name]) > MAX_TEXT_BYTES:
            raise BundleError(f"{name} has {len(members[name])} bytes, {MAX_TEXT_BYTES} are allowed")
    manifest = read_json(members.pop(MANIFEST_FILE), Manifest, MANIFEST_FILE)
    text = members.pop(CARD_FILE)
    _check_digest(text, manifest.card_sha256, CARD_FILE)
    card = read_card(text)
    source = {name.removeprefix(SOURCE): members.pop(name) for name in sorted(members) if name.startswith(SOURCE)}
    if set(source) != set(manifest.source):
        raise BundleError(f"source holds {sorted(source)}, the manifest lists {sorted(manifest.source)}")
    for name, file in source.items():
        if len(file) > MAX_SOURCE_BYTES:
            raise BundleError(f"{SOURCE}{name} has {len(file)} bytes, {MAX_SOURCE_BYTES} are allowed")
        _check_digest(file, manifest.source[name], SOURCE + name)
    if members:
        raise BundleError(f"the manifest does not list {min(members)}")
    return Bundle(manifest.spec, card, source)


def _check_digest(content: bytes, sha256: str, name: str) -> None:
    if hashlib.sha256(content).hexdigest() != sha256:
        raise BundleError(f"{name} is not the one that was packed: its digest does not fit the manifest")


def read_members(content: bytes, names: re.Pattern[str] = MEMBER) -> dict[str, bytes]:
    """Content by name of a zip of stored plain files whose names match; raises `BundleError`."""
    if len(content) > MAX_BUNDLE_BYTES:
        raise BundleError(f"the bundle has {len(content)} bytes, {MAX_BUNDLE_BYTES} are allowed")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            infos = archive.infolist()
            _check_infos(infos, len(content), names)
            return {info.filename: archive.read(info) for info in infos}
    except (zipfile.BadZipFile, *UNREADABLE) as error:
        raise BundleError(f"this is no bundle: {type(error).__name__}: {' '.join(str(error).split())[:200]}") from None


def _check_infos(infos: list[zipfile.ZipInfo], size: int, names: re.Pattern[str]) -> None:
    """Refuses whatever `write_bundle` does not write, before anything of it is read."""
    if len(infos) > MAX_MEMBERS:
        raise BundleError(f"the bundle has {len(infos)} members, {MAX_MEMBERS} are allowed")
    seen = set()
    for info in infos:
        name = info.filename
        if len(name) > MAX_NAME_CHARACTERS or not names.fullmatch(name):
            raise BundleError(f"a member is named {name[:80]!r}, as none that `pdrbench submit pack` writes")
        if name in seen:
            raise BundleError(f"the bundle holds {name} twice")
        seen.add(name)
        if info.flag_bits & ENCRYPTED:
            raise BundleError(f"{name} is encrypted")
        if info.external_attr >> 16 & FILE_KIND not in (0, PLAIN_FILE & FILE_KIND):
            raise BundleError(f"{name} is a link or another kind of file that is none")
        if info.compress_type != zipfile.ZIP_STORED or info.compress_size != info.file_size:
            raise BundleError(f"{name} is compressed; members of a bundle are stored as they are")
    ends = 0
    for info in sorted(infos, key=lambda info: info.header_offset):
        if info.header_offset < ends:
            raise BundleError(f"{info.filename} overlaps another member")
        ends = info.header_offset + LOCAL_HEADER_BYTES + len(info.filename) + info.file_size
    if ends > size:
        raise BundleError("the bundle is cut off")
