"""Signatures of maintainers: only whoever holds a listed key can make an entry a verified one.

A signed file holds the text that was signed, the id of a key and an ed25519 signature of that text's bytes. Public keys
stand in `keys.toml` beside the entries; a private key is a file of its maintainer and lies outside of the repository.
"""

from __future__ import annotations

import datetime
import hashlib
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec

from pdrbench.errors import BundleError, ResultError
from pdrbench_leaderboard.schema import Line, Name, Record, read_json, read_limited, read_toml, write_json

KEYS_FILE: Final = "keys.toml"
CONTEXT: Final = b"pdrbench verification 2\n"  # signed before the text: a signature is of nothing else
PRIVATE_MODE: Final = 0o600
PRIVATE_DIGITS: Final = 64  # of the seed in hex
MAX_BODY_CHARACTERS: Final = 16_000_000

HexKey = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]


class PublicKey(Record, frozen=True, kw_only=True, rename={"since": "from"}):
    """One table of `keys.toml`."""

    public: HexKey  # ed25519
    owner: Line
    since: datetime.date  # no verification is older
    revoked: datetime.date | None = None  # since when nothing that it signed counts, whenever it was signed


class Signed(Record, frozen=True, kw_only=True):
    """The content of a signed file."""

    body: Annotated[str, msgspec.Meta(max_length=MAX_BODY_CHARACTERS)]  # what was signed, as it was
    key: Annotated[str, msgspec.Meta(pattern=r"^([A-Za-z0-9][A-Za-z0-9_.-]{0,79})?\Z")] = ""  # id in `keys.toml`
    signature: Annotated[str, msgspec.Meta(pattern=r"^([0-9a-f]{128})?\Z")] = ""


Keys = Mapping[str, PublicKey]


def read_keys(root: Path) -> Keys:
    """Public keys by id, from `keys.toml` of a folder of leaderboards; none where there is no such file.

    Raises:
        BundleError: It is no such file.
    """
    path = root / KEYS_FILE
    return read_toml(read_limited(path, 1 << 16), dict[Name, PublicKey], str(path)) if path.is_file() else {}


def signed_text(content: bytes, keys: Keys, what: str) -> tuple[str, PublicKey]:
    """The text of a signed file, and the key that signed it.

    Raises:
        BundleError: It is no signed file, its key is not listed or was revoked, or the signature is of another text.
    """
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    signed = read_json(content, Signed, what)
    if not signed.key or not signed.signature:
        raise BundleError(f"{what} is not signed: `pdrbench leaderboard run --key FILE` signs what it plays")
    key = keys.get(signed.key)
    if key is None:
        raise BundleError(f"{what} is signed with the key {signed.key!r}, which {KEYS_FILE} does not list")
    if key.revoked is not None:
        raise BundleError(
            f"{what} is signed with the key {signed.key!r}, revoked on {key.revoked}: the entry is to be played anew"
        )
    try:
        public = Ed25519PublicKey.from_public_bytes(bytes.fromhex(key.public))
        public.verify(bytes.fromhex(signed.signature), CONTEXT + signed.body.encode())
    except (InvalidSignature, ValueError):  # a surrogate in the text has no bytes
        raise BundleError(f"{what}: the signature is not of this text by the key {signed.key!r}") from None
    return signed.body, key


def sign(record: msgspec.Struct, key: Path) -> bytes:
    """A signed file that holds a record; raises `BundleError`."""
    private = _private(key)
    body = write_json(record).decode()
    signature = private.sign(CONTEXT + body.encode()).hex()
    return write_json(Signed(body=body, key=_id(_public_hex(private)), signature=signature))


def new_key(path: Path, owner: str, today: datetime.date) -> str:
    """Writes a new private key that only its owner can read; the table of it for `keys.toml`.

    Raises:
        ResultError: The file cannot be written, or there is one already.
    """
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    private = Ed25519PrivateKey.generate()
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE_MODE)
        with os.fdopen(descriptor, "wb") as file:
            file.write(private.private_bytes_raw().hex().encode() + b"\n")
    except OSError as error:
        raise ResultError(f"cannot write {path}: {error.strerror}; a private key never replaces a file") from error
    return key_table(path, owner, today)


def key_table(path: Path, owner: str, today: datetime.date) -> str:
    """What `keys.toml` says of a private key."""
    public = _public_hex(_private(path))
    quoted = msgspec.json.encode(owner).decode()
    return f'[{_id(public)}]\npublic = "{public}"\nowner = {quoted}\nfrom = {today}\n'


def check_listed(path: Path, root: Path) -> None:
    """Raises where a private key cannot be used, or where a folder of leaderboards does not list it.

    Raises:
        BundleError: It cannot be read, others can read it, or the keys of the folder do not list it.
    """
    name = _id(_public_hex(_private(path)))
    if name not in read_keys(root):
        raise BundleError(f"{root / KEYS_FILE} does not list {name}, the key in {path}: what it signs would be refused")


def _id(public: str) -> str:
    return f"key-{hashlib.sha256(public.encode()).hexdigest()[:12]}"


def _public_hex(private: Any) -> str:
    return str(private.public_key().public_bytes_raw().hex())


def _private(path: Path) -> Any:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise BundleError(f"cannot read the private key in {path}: {type(error).__name__}") from None
    if os.name != "nt" and mode & (stat.S_IRWXG | stat.S_IRWXO):  # Windows has no such modes
        raise BundleError(f"{path} can be read by others: chmod 600 {path}, or make a new key if anybody has")
    try:
        if len(text) != PRIVATE_DIGITS:
            raise ValueError
        return Ed25519PrivateKey.from_private_bytes(bytes.fromhex(text))
    except ValueError:
        raise BundleError(f"{path} holds no private key; `pdrbench leaderboard key new FILE` makes one") from None
