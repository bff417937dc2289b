"""What environments share whose walks are recordings: the check of a file before it is read, and opaque ids."""

from __future__ import annotations

import hashlib
from pathlib import Path

from pdrbench.datasets.integrity import sha256_of_content
from pdrbench.errors import DatasetError
from pdrbench.files import known_sha256


def checked_file(place: Path, sha256: str, dataset: str, remedy: str, content_sha256: str = "") -> Path:
    """The same path, once the content of the file is known to be the one that is meant.

    Args:
        place: Of the file.
        sha256: Of its content, hexadecimal.
        dataset: Name of the registered dataset that it belongs to.
        remedy: What a user can do, besides putting the original back, where the file has other content.
        content_sha256: Of what the file holds if it is compressed; where it is right, the compression does not count.

    Raises:
        DatasetError: The file cannot be read, or has other content.
    """
    try:
        found = known_sha256(place)
    except OSError as error:
        raise DatasetError(
            f"{place}: cannot be read: {error.strerror}; run `pdrbench data verify {dataset}` and replace what it names"
        ) from error
    if found != sha256 and not (content_sha256 and sha256_of_content(place) == content_sha256):
        raise DatasetError(
            f"{place}: sha256 is {found[:12]}..., expected {sha256[:12]}...; the file was changed: put the original "
            f"back, or {remedy}"
        )
    return place


def opaque_id(path: str, key: bytes) -> str:
    """Eight hexadecimal digits that reveal nothing of the time or place of a walk, and give the order of play."""
    return hashlib.blake2b(path.encode(), digest_size=4, key=key).hexdigest()
