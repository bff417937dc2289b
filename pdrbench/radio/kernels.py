"""Compiled kernels of fingerprints: lists of readings by access point, and the distance of a scan from all of them."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdrbench.compiled import compiled
from pdrbench.geometry import FloatArray, IntArray

# The difference of two sums is mostly rounding where a reading counts less: 128 times the 1e-16 of a sum
MIN_WEIGHT: Final = 1.0 / 128.0


class InvertedLists(NamedTuple):
    """The readings of S fingerprints, access point by access point.

    Attributes:
        access_point: (A,) int, sorted.
        first: (A + 1,) int, access point a owns the readings `first[a]:first[a + 1]`.
        fingerprint: (R,) int, of each reading; rising within an access point.
        strength: (R,) of each reading.
        norm2: (S,) sum of the squared strengths of each fingerprint.
        scale: (S,) one over its root; 0 where a fingerprint has no reading.
    """

    access_point: IntArray
    first: IntArray
    fingerprint: NDArray[np.uint32]
    strength: FloatArray
    norm2: FloatArray
    scale: FloatArray


@compiled
def strongest_readings(known: Any, access_point: Any, strength: Any) -> Any:
    """(A,) reading of each known access point, the strongest and of equals the last; -1 where there is none.

    Args:
        known: (A,) sorted.
        access_point: (n,) of each reading.
        strength: (n,) of each reading, in any unit.
    """
    reading = np.empty(len(known), dtype=np.int64)
    reading[:] = -1
    for i in range(len(access_point)):
        a = np.searchsorted(known, access_point[i])
        is_known = a < len(known) and known[a] == access_point[i]
        if is_known and (reading[a] < 0 or strength[i] >= strength[reading[a]]):
            reading[a] = i
    return reading


@compiled
def inverse_roots(norm2: Any) -> Any:
    """(S,) one over the square root, 0 where there is none."""
    scale = np.empty(len(norm2))
    for f in range(len(norm2)):
        scale[f] = 1.0 / math.sqrt(norm2[f]) if norm2[f] > 0.0 else 0.0
    return scale


@compiled
def distances(lists: Any, access_point: Any, strength: Any, weight: Any, is_ochiai: bool) -> Any:
    """(S,) distance of a scan from each fingerprint; (0,) where no access point is known.

    One minus the sum of w s f over root(sum of w s^2) root(sum of w f^2), the cosine; of w min(s, f)^2 for Ochiai's.
    Sums go from access point to access point. Where no reading is too light, only the lists of the scan are read.

    Args:
        lists: See `InvertedLists`.
        access_point: (n,) of each reading of the scan; of one that stands twice the strongest reading counts.
        strength: (n,) of each reading.
        weight: (n,) of each reading; an access point without a reading counts 1.
        is_ochiai: Whether what both received counts by the weaker of the two.
    """
    reading = strongest_readings(lists.access_point, access_point, strength)
    product, num_heard, scan_norm2, lightest, is_weighted = np.zeros(len(lists.norm2)), 0, 0.0, 1.0, False
    for a in range(len(reading)):
        if reading[a] >= 0:
            s, w = strength[reading[a]], weight[reading[a]]
            num_heard, scan_norm2 = num_heard + 1, scan_norm2 + w * s * s
            lightest, is_weighted = min(lightest, w), is_weighted or w != 1.0
            for k in range(np.uint64(lists.first[a]), np.uint64(lists.first[a + 1])):  # unsigned: none is from the end
                own = lists.strength[k]
                product[lists.fingerprint[k]] += w * (min(s, own) ** 2 if is_ochiai else s * own)
    if num_heard == 0:
        return product[:0]
    scale = _weighted_scale(lists, reading, weight, lightest < MIN_WEIGHT) if is_weighted else lists.scale
    scan_scale = 1.0 / math.sqrt(scan_norm2) if scan_norm2 > 0.0 else 0.0
    for f in range(len(product)):
        product[f] = 1.0 - product[f] * (scale[f] * scan_scale)
    return product


@compiled
def _weighted_scale(lists: Any, reading: Any, weight: Any, is_anew: bool) -> Any:
    """(S,) one over the norm of each fingerprint with the weights of a scan, summed anew or by what they change."""
    norm2 = np.empty(len(lists.norm2))
    for k in range(len(norm2)):
        norm2[k] = 0.0 if is_anew else lists.norm2[k]
    for a in range(len(reading)):
        if is_anew or reading[a] >= 0:
            w = (weight[reading[a]] if reading[a] >= 0 else 1.0) - (0.0 if is_anew else 1.0)
            for k in range(np.uint64(lists.first[a]), np.uint64(lists.first[a + 1])):
                norm2[lists.fingerprint[k]] += w * lists.strength[k] ** 2
    return inverse_roots(norm2)


def warm_up() -> None:
    """Compares a scan with a survey of one fingerprint."""
    one, strength = np.zeros(1, dtype=np.int64), np.ones(1)
    lists = InvertedLists(one, np.array([0, 1]), one.astype(np.uint32), strength, strength, inverse_roots(strength))
    distances(lists, strength, strength, strength, False)
