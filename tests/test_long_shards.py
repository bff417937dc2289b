"""Every long test runs in one of the shards, which take about the same time."""

from __future__ import annotations

import pytest

from .conftest import shard_of


@pytest.mark.parametrize("count", [1, 7, 40])
def test_shards_divide_and_balance_long_tests(count: int) -> None:
    seconds = {f"test_{number}": 1.0 + number**2 % 90 for number in range(36)}
    shards = [shard_of(seconds, number, count) for number in range(1, count + 1)]
    assert sorted(name for shard in shards for name in shard) == sorted(seconds)
    sums_s = [sum(seconds[name] for name in shard) for shard in shards]
    assert max(sums_s) - min(sums_s) <= max(seconds.values())  # the longest-first rule
    assert shards[0] == shard_of(dict(reversed(seconds.items())), 1, count)
