"""Maps of transitions: counts, the formula of the paper, copies, and tables that grow and fill up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench_lab.footslam import kernels, transition_map
from pdrbench_lab.footslam.cloud import OdometryNoise, SlamCloud, SlamParams
from pdrbench_lab.footslam.transition_map import TransitionMaps, effective_number, in_place

STILL = OdometryNoise(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_transition_counts_at_both_of_its_hexagons_and_nowhere_else() -> None:
    maps = TransitionMaps(2, 0)
    maps.add(0, (-3, 5, -1), 2)
    maps.add(0, (-4, 6, -1), 5)  # the same edge from the other side
    assert maps.counts_at(0, (-3, 5, -1)).tolist() == [0, 0, 2, 0, 0, 0]
    assert maps.counts_at(0, (-4, 6, -1)).tolist() == [0, 0, 0, 0, 0, 2]
    assert maps.counts_at(0, (-3, 5, 0)).sum() == maps.counts_at(1, (-3, 5, -1)).sum() == 0
    hexagon, counts = maps.known(0)
    assert sorted(map(tuple, hexagon.tolist())) == [(-4, 6, -1), (-3, 5, -1)]
    assert counts.sum() == 4


def test_gains_are_those_of_the_paper_over_those_of_an_unknown_place() -> None:
    maps = TransitionMaps(1, 0)
    assert maps.log_gain(0, (0, 0, 0), 4, 0.8) == 0.0
    for edge in (0, 0, 3):
        maps.add(0, (0, 0, 0), edge)
    for edge, count in ((0, 2), (3, 1), (4, 0)):
        ratio = (count + 0.8) / (3 + 6 * 0.8) / (1 / 6)
        assert maps.log_gain(0, (0, 0, 0), edge, 0.8) == pytest.approx(math.log(ratio))


def test_gains_of_all_edges_are_a_distribution(rng: np.random.Generator) -> None:
    maps = TransitionMaps(1, 0)
    for edge in rng.integers(6, size=40):
        maps.add(0, (1, 1, 0), int(edge))
    assert sum(math.exp(maps.log_gain(0, (1, 1, 0), e, 0.3)) / 6 for e in range(6)) == pytest.approx(1.0)


def test_tables_grow_and_keep_what_they_know() -> None:
    maps = TransitionMaps(2, 0)
    for q in range(1000):
        maps.add(1, (q - 500, 7, 2), 1)
    assert maps.num_slots == 4 * transition_map.FIRST_SLOTS * 2  # 2000 hexagons, at most three quarters full
    assert all(maps.counts_at(1, (q - 500, 7, 2))[1] == 1 for q in range(1000))
    assert maps.num_bytes < 11 * 2 * maps.num_slots


def test_a_full_table_learns_no_hexagon_and_counts_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transition_map, "MAX_SLOTS", transition_map.FIRST_SLOTS)
    maps = TransitionMaps(1, 0)
    for _ in range(2):
        for q in range(1000):
            maps.add(0, (q, 0, 0), 1)
    hexagon, counts = maps.known(0)
    assert maps.num_slots == transition_map.FIRST_SLOTS
    assert len(hexagon) == 3 * transition_map.FIRST_SLOTS // 4
    assert (counts.sum(axis=1) == 2).all()


def test_counts_stop_at_what_a_byte_holds() -> None:
    maps = TransitionMaps(1, 0)
    for _ in range(300):
        maps.add(0, (0, 0, 0), 1)
    assert maps.counts_at(0, (0, 0, 0))[1] == kernels.MAX_COUNT


def test_a_copied_map_goes_its_own_way() -> None:
    maps = TransitionMaps(2, 0)
    maps.add(0, (0, 0, 0), 1)
    maps.replace(np.array([0, 0]))
    maps.add(1, (0, 0, 0), 1)
    assert [maps.counts_at(particle, (0, 0, 0))[1] for particle in (0, 1)] == [1, 2]


def test_ancestors_in_place_are_the_same_ancestors(rng: np.random.Generator) -> None:
    ancestor = np.sort(rng.integers(50, size=50))
    source = in_place(ancestor)
    assert np.array_equal(np.sort(source), ancestor)
    assert all(source[i] == i for i in set(ancestor.tolist()))


def test_effective_number_of_equal_and_of_one_weight() -> None:
    assert effective_number(np.full(7, -800.0)) == pytest.approx(7.0)
    assert effective_number(np.array([0.0, -800.0, -800.0])) == pytest.approx(1.0)


@pytest.mark.parametrize("delay", [0, 3])
def test_a_transition_waits_until_others_have_followed(delay: int, rng: np.random.Generator) -> None:
    cloud = SlamCloud(np.zeros(2), 0.0, STILL, SlamParams(num_particles=1, radius_m=1.0, delay=delay), rng)
    for _ in range(5):
        cloud.stride(math.sqrt(3.0), 0.0, 0)
    counted = [cloud.maps.counts_at(0, (q, 0, 0))[0] for q in range(5)]
    assert counted == [1] * (5 - delay) + [0] * delay
