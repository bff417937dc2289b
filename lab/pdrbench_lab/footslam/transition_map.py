"""Counts of transitions across the edges of hexagons, for each particle its own.

Memory: 10 bytes a slot and particle, which is 10 MB for 2000 particles and 512 slots at first; twice as many where a
table is three quarters full, up to `MAX_SLOTS`: 164 MB, enough for 3 km of ways that were not walked before. A particle
whose table is full at that size learns no new hexagon and goes on counting in those that it knows.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.geometry import FloatArray, IntArray
from pdrbench_lab.footslam import kernels

FIRST_SLOTS: Final = 512
MAX_SLOTS: Final = 8192
ROOM: Final = 64  # slots that one stride may take at most: two for each edge


class TransitionMaps:
    """The maps of N particles.

    Args:
        num_particles: N.
        delay: A transition is counted once so many have followed it, so that the way just walked says nothing.
    """

    def __init__(self, num_particles: int, delay: int) -> None:
        self._keys = np.full((num_particles, FIRST_SLOTS), kernels.EMPTY, dtype=np.int32)
        self._counts = np.zeros((num_particles, FIRST_SLOTS, 6), dtype=np.uint8)
        self._used = np.zeros(num_particles, dtype=np.int64)
        self._pending = np.full((num_particles, delay, 2), kernels.EMPTY, dtype=np.int32)
        self._at = np.zeros((num_particles, 1), dtype=np.int64)

    def __len__(self) -> int:
        return len(self._keys)

    @property
    def tables(self) -> tuple[NDArray[Any], ...]:
        """As `kernels.stride` takes and changes them."""
        return self._keys, self._counts, self._used, self._pending, self._at

    @property
    def num_bytes(self) -> int:
        """Size of all tables."""
        return sum(table.nbytes for table in self.tables)

    @property
    def num_slots(self) -> int:
        """Of each table."""
        return int(self._keys.shape[1])

    def make_room(self) -> None:
        """Makes tables twice as large where one could become too full within a stride."""
        is_full = 4 * (int(self._used.max(initial=0)) + ROOM) > 3 * self.num_slots
        if is_full and self.num_slots < MAX_SLOTS:
            self.enlarge()

    def enlarge(self) -> None:
        """Makes every table twice as large."""
        keys = np.full((len(self), 2 * self.num_slots), kernels.EMPTY, dtype=np.int32)
        counts = np.zeros((len(self), 2 * self.num_slots, 6), dtype=np.uint8)
        kernels.rehash(self._keys, self._counts, keys, counts)
        self._keys, self._counts = keys, counts

    def add(self, particle: int, hexagon: tuple[int, int, int], edge: int) -> None:
        """Counts one transition, at once, from a hexagon (q, r, level) through an edge, at both of its hexagons."""
        keys, counts, key = self._keys[particle], self._counts[particle], kernels.key_of(*hexagon)
        self._used[particle] = kernels.add_crossing(keys, counts, int(self._used[particle]), key, edge)
        self.make_room()

    def counts_at(self, particle: int, hexagon: tuple[int, int, int]) -> IntArray:
        """(6,) transitions through the edges of a hexagon (q, r, level), in either direction."""
        key = kernels.key_of(*hexagon)
        slot = kernels.slot_of(self._keys[particle], key)
        counts: IntArray = self._counts[particle, slot].astype(np.int64)
        return counts

    def log_gain(self, particle: int, hexagon: tuple[int, int, int], edge: int, alpha: float) -> float:
        """log of 6 (N_e + alpha) / (N_h + 6 alpha): 0 where nothing is known of the hexagon."""
        key = kernels.key_of(*hexagon)
        return float(kernels.log_gain(self._keys[particle], self._counts[particle], key, edge, alpha))

    def known(self, particle: int) -> tuple[IntArray, IntArray]:
        """The map of one particle.

        Returns:
            hexagon: (H, 3) q, r, level of the hexagons that it has counts of.
            counts: (H, 6).
        """
        slots = np.flatnonzero(self._keys[particle] != kernels.EMPTY)
        key = self._keys[particle, slots].astype(np.int64)
        bits, half = kernels.COORDINATE_BITS, 1 << (kernels.COORDINATE_BITS - 1)
        q, r = (((part & kernels.MASK) + half & kernels.MASK) - half for part in (key, key >> bits))
        level = ((key >> 2 * bits) + 64 & kernels.LEVEL_MASK) - 64
        return np.column_stack([q, r, level]), self._counts[particle, slots].astype(np.int64)

    def replace(self, source: IntArray) -> None:
        """Gives every particle i a copy of the map of `source[i]`; see `in_place`."""
        kernels.copy_tables(source, self.tables)


def in_place(ancestor: IntArray) -> IntArray:
    """(N,) the same ancestors in an order in which those that have offspring keep their place: few maps are copied.

    >>> in_place(np.array([1, 1, 1, 3])).tolist()
    [1, 1, 1, 3]
    >>> in_place(np.array([0, 0, 2, 2])).tolist()
    [0, 0, 2, 2]
    >>> in_place(np.array([1, 1, 2, 2])).tolist()
    [1, 1, 2, 2]
    """
    count = np.bincount(ancestor, minlength=len(ancestor))
    source = np.arange(len(ancestor))
    source[count == 0] = np.repeat(source, np.maximum(count - 1, 0))
    return source


def effective_number(log_weight: FloatArray) -> float:
    """1 / sum of squares of the normalised weights: N where all are equal."""
    weight = np.exp(log_weight - log_weight.max())
    return float(weight.sum() ** 2 / np.square(weight).sum())
