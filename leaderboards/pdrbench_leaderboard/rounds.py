"""Rounds: secrets that follow from one master secret, how a round begins and ends, and who has submitted in it."""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from pdrbench.errors import BundleError
from pdrbench.evaluation.store import make_folder, write_whole
from pdrbench.task import commitment
from pdrbench_leaderboard.card import Card
from pdrbench_leaderboard.schema import Count, EntryName, Record, Remark, Sha256, read_json, read_limited, write_json

SALT: Final = b"pdrbench rounds"
SUBMISSIONS_FILE: Final = "submissions.json"
MAX_SUBMISSIONS: Final = 3  # of one author in a round: each tells something of its held-out walks
MAX_FILE_BYTES: Final = 16_000_000


class Submission(Record, frozen=True, kw_only=True):
    """Code that was played in a round whose secret was not published."""

    round: Count
    author: Remark  # contact, or the first name, of its card
    name: EntryName
    sha256: Sha256  # of the code


def round_secret(master: str, number: int) -> str:
    """The secret of a round: HKDF (RFC 5869) of the master secret, with SHA-256; 64 hexadecimal digits."""
    key = hmac.new(SALT, master.encode(), hashlib.sha256).digest()
    return hmac.new(key, f"round {number}".encode() + b"\x01", hashlib.sha256).hexdigest()


def begin_round(path: Path, numbers: Sequence[int], master: str) -> tuple[int, str]:
    """Adds the next round to a file of rounds.

    Args:
        path: `boards.toml`.
        numbers: Of the rounds in it.
        master: Secret behind all rounds.

    Returns:
        Its number, and what is published of its secret.

    Raises:
        BundleError: The file cannot be written.
        PdrbenchError: The master secret could be guessed.
    """
    commitment(master)
    number = max(numbers, default=-1) + 1
    digest = commitment(round_secret(master, number))
    begun = f'\n\n[[rounds]]\nnumber = {number}\ncommitment = "{digest}"\n'
    write_whole(path, read_limited(path, MAX_FILE_BYTES).rstrip() + begun.encode())
    return number, digest


def end_round(path: Path, number: int, master: str) -> str:
    """Publishes the secret of a round in the place of its commitment, and returns it; raises `BundleError`."""
    secret = round_secret(master, number)
    text, line = read_limited(path, MAX_FILE_BYTES).decode(), f'commitment = "{commitment(secret)}"'
    if text.count(line) != 1:
        raise BundleError(f"{path} has no open round {number} of this master secret")
    write_whole(path, text.replace(line, f'secret = "{secret}"').encode())
    return secret


def author_of(card: Card) -> str:
    """Who submits, as far as a card says: the contact, else the first author."""
    return " ".join((card.contact or card.authors[0]).lower().split())


def read_submissions(root: Path) -> tuple[Submission, ...]:
    """What was played in rounds that were open then; raises `BundleError`."""
    path = root / SUBMISSIONS_FILE
    if not path.is_file():
        return ()
    return read_json(read_limited(path, MAX_FILE_BYTES), tuple[Submission, ...], str(path))


def has_to_wait(root: Path, number: int, card: Card, sha256: str) -> bool:
    """Whether an author has submitted so often in a round that other code waits for the next; else it is noted."""
    known, author = read_submissions(root), author_of(card)
    codes = {of.sha256 for of in known if (of.round, of.author) == (number, author)}
    if sha256 in codes:
        return False
    if len(codes) >= MAX_SUBMISSIONS:
        return True
    one = Submission(round=number, author=author, name=card.name, sha256=sha256)
    make_folder(root)
    write_whole(root / SUBMISSIONS_FILE, write_json((*known, one)))
    return False
