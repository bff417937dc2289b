"""Pieces of recordings in which people walk, and whose they are."""

from __future__ import annotations

import numpy as np

from pdrbench_lab.realism.classifier import PERSON
from pdrbench_lab.realism.people import HAND, by_people, walked_pieces
from pdrbench_lab.realism.targets import reduce


def recording(rng: np.random.Generator, seconds: int, still: slice) -> np.ndarray:
    """Rows of a phone that goes up and down twice a second, but for some seconds."""
    t_s = np.arange(50 * seconds) / 50
    up = 3 * np.cos(2 * np.pi * 2 * t_s) + 0.1 * rng.normal(size=len(t_s))
    up[50 * still.start : 50 * still.stop] = 0.0
    return np.column_stack([t_s, np.zeros((len(t_s), 2)), 9.81 + up])


def test_pieces_in_which_people_stand_are_left_out(rng: np.random.Generator) -> None:
    rows = recording(rng, 95, slice(30, 50))
    pieces = list(walked_pieces(rows))
    assert [round(float(piece[0, 0])) for piece in pieces] == [0, 60]
    assert not list(walked_pieces(rows[: 50 * 8]))  # too short


def test_every_piece_belongs_to_its_person_and_is_stored_so(rng: np.random.Generator) -> None:
    walks = [recording(rng, 62, slice(0, 0)) for _ in range(3)]
    found = by_people({-1: walks[:1], 3: walks[1:]})
    assert found[PERSON].tolist() == [-1, -1, 3, 3, 3, 3]
    assert reduce(HAND, found).features[PERSON] == [-1, -1, 3, 3, 3, 3]
