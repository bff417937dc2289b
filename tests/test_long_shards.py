"""Every long test runs in one of the shards, which take about the same time, every slow one on one of some days."""

from __future__ import annotations

import pytest

from .conftest import DAYS, SLOW_DAYS, has_its_day, shard_of


@pytest.mark.parametrize("count", [1, 7, 40])
def test_shards_divide_and_balance_long_tests(count: int) -> None:
    seconds = {f"test_{number}": 1.0 + number**2 % 90 for number in range(36)}
    shards = [shard_of(seconds, number, count) for number in range(1, count + 1)]
    assert sorted(name for shard in shards for name in shard) == sorted(seconds)
    sums_s = [sum(seconds[name] for name in shard) for shard in shards]
    assert max(sums_s) - min(sums_s) <= max(seconds.values())  # the longest-first rule
    assert shards[0] == shard_of(dict(reversed(seconds.items())), 1, count)


def test_every_slow_test_has_one_of_some_days_and_so_across_the_end_of_a_round() -> None:
    names = [f"tests/test_{number}.py::test" for number in range(300)]
    days = [*range(1, DAYS + 1), *range(1, DAYS + 1)]  # numbers of the shards, one a day
    for first in range(len(days) - SLOW_DAYS + 1):
        assert all(sum(has_its_day(name, day) for day in days[first : first + SLOW_DAYS]) == 1 for name in names)
    assert all(sum(has_its_day(name, day) for name in names) > 70 for day in range(SLOW_DAYS))  # of 100
