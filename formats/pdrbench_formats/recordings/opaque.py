"""Stable numbers in place of addresses of access points and beacons."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from pdrbench.geometry import FloatArray


def opaque_id(kind: str, address: str | bytes) -> int:
    """A stable number below 2**48 in place of an address, exact in float64.

    Args:
        kind: "wifi" or "ble".
        address: As the file has it; capitals make no difference.

    >>> opaque_id("wifi", "02:00:00:00:00:01") == opaque_id("wifi", "02:00:00:00:00:02")
    False
    """
    return int(opaque_ids(kind, [address.encode() if isinstance(address, str) else address])[0])


def _as_written_most(address: bytes) -> bytes:
    """An address with small letters and, where it is one of hardware, colons, in whatever way it was written."""
    digits = address.lower().translate(None, b":-.")
    is_mac = len(digits) == 12 and not digits.strip(b"0123456789abcdef")
    return b":".join(digits[k : k + 2] for k in range(0, 12, 2)) if is_mac else address.lower()


def opaque_ids(kind: str, addresses: Sequence[bytes]) -> FloatArray:
    """(L,) number of each address; the same numbers for a site in whatever format its walks were recorded."""
    empty = hashlib.blake2b(digest_size=6, person=b"pdrbench." + kind.encode())
    digests = {}
    for address in addresses:
        if address not in digests:
            hasher = empty.copy()  # faster than a new one
            hasher.update(_as_written_most(address))
            digests[address] = hasher.digest()
    digits = np.frombuffer(b"".join([digests[address] for address in addresses]), dtype=np.uint8).reshape(-1, 6)
    numbers: FloatArray = digits @ 256.0 ** np.arange(5, -1, -1)  # exact: 48 bits
    return numbers
