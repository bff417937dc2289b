"""Results on disk: one file each, whole or not at all, with a checksum, nothing unpickled.

A file is one line `pdrbench-result 3 <sha256 of the rest>`, one line of JSON, the times of the answers and how long
each took as little-endian float64, and the answers in whole steps (`answers`): those that were given, then those of
`revise` where there are any.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.datasets.folders import cache_folder
from pdrbench.errors import ResultError
from pdrbench.evaluation import answers
from pdrbench.files import safe_name
from pdrbench.result import Result

MAGIC: Final = b"pdrbench-result 3 "
SUFFIX: Final = ".result"
MAX_REMEMBERED: Final = 20_000  # facts in one file of the cache
TEMPORARY_SUFFIX: Final = ".tmp"
# Fields of a result as they are
PLAIN: Final = ("env", "split", "walk", "localizer", "seed", "status", "failure", "division")
TIMES: Final = 2  # columns of times before the answers
DIGEST_CHARACTERS: Final = 64
KEY_CHARACTERS_IN_NAME: Final = 20  # 80 bits
MAX_PART: Final = 40  # characters of an id in a name


def result_key(ingredients: Mapping[str, object]) -> str:
    """Sha256 of everything that determines a result; the same whatever the order of the mapping."""
    return hashlib.sha256(_to_json(ingredients, "what produces a result")).hexdigest()


def result_name(env: str, localizer: str, walk: str, seed: int, key: str) -> str:
    """File name that a person can read and that differs where the key does."""
    parts = [safe_name(part, MAX_PART) for part in (env, localizer, walk)]
    return ".".join([*parts, f"s{seed}", key[:KEY_CHARACTERS_IN_NAME]]) + SUFFIX


def write_whole(path: Path, content: bytes) -> None:
    """Writes a file whole or not at all, and waits until it has reached the disk.

    That its folder has, `files.sync` waits for, once for many files: a name that a power cut takes back is a walk to
    compute again, never a torn file.

    Raises:
        ResultError: The disk is full, or the folder cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}{TEMPORARY_SUFFIX}")
    try:
        with temporary.open("xb") as file:  # read by whom the user lets: not `tempfile`, whose files are private
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise ResultError(
            f"cannot write result {path}: {error.strerror or error}; "
            f"mend that and run the same command again: what is stored already is kept"
        ) from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def keep_whole(path: Path, content: bytes) -> None:
    """Keeps a file for the next process, which makes it again where that is impossible."""
    with contextlib.suppress(OSError, ResultError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)


def remembered(name: str) -> dict[str, Any]:
    """What a run before has left in a file of the cache folder; empty where there is none."""
    try:
        known = json.loads((cache_folder() / name).read_bytes())
        return known if isinstance(known, dict) and len(known) <= MAX_REMEMBERED else {}
    except (OSError, ValueError, RecursionError):
        return {}


def remember(name: str, known: dict[str, Any]) -> None:
    """Leaves it for the next process."""
    keep_whole(cache_folder() / name, json.dumps(known).encode())


def load(path: Path | str) -> Result:
    """Reads a result.

    Raises:
        ResultError: It is missing, torn, foreign or from another format version.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ResultError(f"cannot read result {path}: {error.strerror or error}") from error
    return decode(content, str(path))


def encode(result: Result) -> bytes:
    """The bytes of a result file."""
    estimates = result.estimates
    times_s = np.vstack([estimates.t_s, result.step_s]).astype("<f8")
    header = {name: getattr(result, name) for name in PLAIN} | {
        "missing": dict(result.missing),
        "reset_s": result.reset_s if math.isfinite(result.reset_s) else None,
        "revise_s": result.revise_s if math.isfinite(result.revise_s) else None,
        "provenance": dict(result.provenance),
        "rows": len(estimates),
        "is_revised": result.revised is not None,
    }
    body = _to_json(header, f"result of walk {result.walk!r}") + b"\n" + times_s.tobytes()
    for given in (estimates, result.revised):
        body += b"" if given is None else answers.encode(answers.whole_numbers(given))
    return MAGIC + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


def decode(content: bytes, name: str) -> Result:
    """The result in the bytes of a file; `name` is for errors."""
    if not content.startswith(MAGIC):
        raise ResultError(f"{name} is no result of this version: it does not begin with {MAGIC.decode()!r}")
    begin = len(MAGIC) + DIGEST_CHARACTERS + 1
    digest, body = content[len(MAGIC) : begin - 1], content[begin:]
    if hashlib.sha256(body).hexdigest().encode() != digest:
        raise ResultError(f"{name} is torn: its checksum does not fit; delete it, the walk is computed again")
    line, _, raw = body.partition(b"\n")
    header = json.loads(line)
    step_s, estimates, *revised = _columns(header["rows"], 1 + header["is_revised"], raw, name)
    return Result(
        **{name: header[name] for name in PLAIN},
        estimates=estimates,
        revised=revised[0] if revised else None,
        step_s=step_s,
        reset_s=math.nan if header["reset_s"] is None else header["reset_s"],
        missing=header["missing"],
        provenance=header["provenance"],
        revise_s=math.nan if header["revise_s"] is None else header["revise_s"],
    )


def _columns(rows: int, blocks: int, raw: bytes, name: str) -> tuple[Any, ...]:
    """How long each answer took, and the answers, once or revised as well."""
    begin = TIMES * rows * 8
    if not 0 <= begin <= len(raw):
        raise ResultError(f"{name}: expected the times of {rows} answers, came {len(raw)} bytes")
    t_s, step_s = np.frombuffer(raw[:begin], dtype="<f8").reshape(TIMES, rows).astype(np.float64)
    found = []
    for _ in range(blocks):
        whole, begin = answers.decode(raw, name, begin)
        if whole.shape[1] != rows:
            raise ResultError(f"{name}: expected {rows} answers, came {whole.shape[1]}")
        found.append(answers.from_whole_numbers(whole, t_s))
    if begin != len(raw):
        raise ResultError(f"{name} holds more than its {rows} answers")
    return step_s, *found


def _to_json(value: object, who: str) -> bytes:
    try:
        return json.dumps(value, sort_keys=True, allow_nan=False, separators=(",", ":")).encode()
    except (TypeError, ValueError) as error:
        raise ResultError(f"{who} holds what JSON cannot hold: {error}; use numbers, text, lists, mappings") from None


def make_folder(path: Path) -> Path:
    """The absolute path of a folder, made where it is missing; raises `ResultError`."""
    folder = path.absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultError(f"cannot make the folder {folder}: {error.strerror or error}") from error
    return folder
