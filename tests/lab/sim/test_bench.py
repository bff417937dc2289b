from __future__ import annotations

import pytest

from pdrbench_lab.speed import simulate as simulate


def test_growth_is_held_against_the_second_shortest_walk() -> None:
    rows = simulate._growth("phone", {1: 0.5, 4: 1.0, 16: 4.0, 64: 32.0})
    assert [row.name for row in rows] == ["phone_1_min", "phone_4_min", "phone_16_min", "phone_64_min"]
    # Four times the walk in four times the time is linear; 16 times the walk in 32 times the time is half as good.
    assert [row.ratio for row in rows] == [None, None, 1.0, 0.5]
    assert all(bool(row.against) == (row.ratio is not None) for row in rows)


@pytest.mark.parametrize("name", list(simulate.SETUPS))
def test_a_walk_is_the_same_bytes_again(name: str) -> None:
    once, again, other = (simulate.walk_once(name, 10.0, seed) for seed in (1, 1, 2))
    assert once == again
    assert once != other


def test_every_stream_counts_in_the_digest() -> None:
    phone = simulate.SETUPS["phone"]
    whole = simulate.simulate_walk(simulate.bench_scene(), 1, phone, duration_s=10.0)
    assert set(whole.streams) == set(phone.sensors)
    assert len(phone.sensors) == 7  # all of them
