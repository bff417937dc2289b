"""Who is ahead, by how much, and how sure that is: the submissions of one environment in their order.

Held-out walks rank: the truth of public ones is public, and an entry that contains it would be first.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np

from pdrbench.errors import ResultError
from pdrbench.evaluation.rows import DRAW_SEED
from pdrbench.evaluation.scoring import Scored
from pdrbench.evaluation.tables import Results
from pdrbench.geometry import FloatArray
from pdrbench.metrics import METRICS
from pdrbench.metrics.statistics import Comparison, compare_pairs, mean_interval
from pdrbench.registry import make_task
from pdrbench.result import OFFLINE
from pdrbench.task import Task, no_survey
from pdrbench_leaderboard.held_out import LOOP_RANKING, values_by_walk
from pdrbench_leaderboard.suites import find_suite
from pdrbench_leaderboard.verification import VERIFIED, HeldOut

if TYPE_CHECKING:
    import pandas as pd

    from pdrbench_leaderboard.card import Card
    from pdrbench_leaderboard.entry import Entry

RANKING: Final = "p75_level_penalised_m"  # EvAAL: it ranks the leaderboards
SIGNIFICANT: Final = 0.05  # of p-values adjusted by Holm [R]
MAX_TESTED: Final = 100  # entries, from the first, that are tested in pairs: 4950 pairs, half a minute (ours)


@dataclass(frozen=True, slots=True)
class Standing:
    """One submission on its leaderboard."""

    entry: Entry  # what was submitted
    row: Mapping[str, Any]  # its line of `Results.rows()`: values and intervals by metric
    scored: tuple[Scored, ...]  # scores and errors of each of its results
    # The metric that ranks, over held-out walks and over public ones, both as `held_out.value_of` has it: value, unit,
    # interval, number of walks; empty where it does not apply
    held_out: Mapping[str, Any] = field(default_factory=dict)
    public: Mapping[str, Any] = field(default_factory=dict)
    rank: int | None = None  # within its division, 1 is first, equal values share a rank; None where it is not ranked
    why_unranked: str = ""  # empty where it is

    @property
    def name(self) -> str:
        """What the entry is called on its leaderboard."""
        return self.entry.localizer

    @property
    def label(self) -> str:
        """Its rank as tables name it: 3, o1 for the first of the offline division, – where it is not ranked."""
        if self.rank is None:
            return "–"
        return f"o{self.rank}" if self.row["division"] == OFFLINE else str(self.rank)

    def metric(self, name: str) -> Mapping[str, Any]:
        """Value, unit, interval and number of walks of one metric on public walks; empty where it does not apply."""
        found: Mapping[str, Any] = self.row["metrics"].get(name, {})
        return found if found.get("value") is not None else {}

    @property
    def gap(self) -> float | None:
        """Held-out score minus public score; None where one of them is missing."""
        return self.held_out["value"] - self.public["value"] if self.held_out and self.public else None


@dataclass(frozen=True)
class Board:
    """The leaderboard of one environment."""

    task: Task
    metric: str  # name of the metric that ranks
    walks: tuple[str, ...]  # walks of the test split that an entry was scored on, in the order of the split
    standings: tuple[Standing, ...]  # ranked ones by held-out value, then the others by public value
    # (H,) by ranked entry: the metric of each held-out walk, mean over seeds
    values: Mapping[str, FloatArray]
    buildings: tuple[str, ...]  # of each public walk
    units: tuple[str, ...]  # of replication, of each public walk
    held_out_units: tuple[int, ...] = ()  # of each held-out walk

    def __len__(self) -> int:
        return len(self.standings)

    @property
    def ranked(self) -> tuple[Standing, ...]:
        """Those that have a rank."""
        return tuple(standing for standing in self.standings if standing.rank is not None)

    def card(self, standing: Standing) -> Card:
        """The card of an entry, with what this environment has of what it uses: a card is for all environments."""
        card = standing.entry.card
        offered = {spec.name for spec in self.task.sensors}
        return msgspec.structs.replace(
            card,
            sensors_used=tuple(name for name in card.sensors_used if name in offered),
            map_used=card.map_used and any(self.buildings),
            survey_used=card.survey_used and self.task.radio_map is not no_survey,
        )

    @functools.cached_property
    def tested(self) -> tuple[Standing, ...]:
        """Those that are tested in pairs: the first of the ranked ones."""
        return self.ranked[:MAX_TESTED]

    @functools.cached_property
    def pairs(self) -> Mapping[tuple[str, str], Comparison]:
        """Every two of the tested entries, the better one first, p-values adjusted over all of them.

        A localizer with one seed is one that does not draw: its walks count as those of every seed.
        """
        tested = {standing.name: self.values[standing.name] for standing in self.tested}
        found = compare_pairs(
            tested,
            rng=np.random.default_rng(DRAW_SEED),
            units=[str(unit) for unit in self.held_out_units],
            better="higher" if METRICS[self.metric].better == "higher" else "lower",
        )
        return {(pair.first, pair.second): pair for pair in found}

    def pair(self, first: str, second: str) -> Comparison | None:
        """The comparison of two entries, the better one first; None where they were not tested."""
        return self.pairs.get((first, second)) or self.pairs.get((second, first))

    def beaten_by(self, name: str) -> tuple[str, ...]:
        """Entries that are significantly worse than this one."""
        return tuple(
            second for (first, second), pair in self.pairs.items() if first == name and pair.p_holm < SIGNIFICANT
        )

    @property
    def is_too_small(self) -> bool:
        """Whether no difference at all could be significant: too few units for so many pairs."""
        return bool(self.pairs) and 2.0 ** (1 - len(set(self.held_out_units))) * len(self.pairs) >= SIGNIFICANT


def make_board(entries: Sequence[Entry], jobs: int = 1, kept: Path | None = None) -> Board:
    """Scores the entries of one environment from their estimates and puts them into order.

    Args:
        entries: At least one, all of one environment, each with a name of its own.
        jobs: Processes that compute the scores.
        kept: Folder where scores are kept, as `Results` takes it.

    Raises:
        ResultError: Two entries have one name, or an entry was made on another version of the environment.
        DatasetError: The environment's recorded data is not found.
    """
    names = [entry.localizer for entry in entries]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ResultError(f"two entries of {entries[0].env} are called {twice!r}; rename one of them")
    task = make_task(entries[0].env)
    results = Results(tuple(itertools.chain.from_iterable(entry.results for entry in entries)), jobs, kept=kept)
    rows = {row["localizer"]: row for row in results.rows()}  # one for each entry, which is of one division
    metric = ranking_metric([*rows.values()])
    walks, public, place = _by_walk(results.walks(), metric, task)
    scored: dict[str, list[Scored]] = {}
    for result, of_run in zip(results.results, results.scored, strict=True):
        scored.setdefault(result.localizer, []).append(of_run)
    standings = [Standing(entry, rows[entry.localizer], tuple(scored[entry.localizer])) for entry in entries]
    seen = {standing.name: _held_out(standing, metric) for standing in standings}
    units = max((found.units for found in seen.values() if found), key=len, default=())
    why = {
        standing.name: _why_unranked(standing, public[standing.name], metric)
        or _why_not_comparable(seen[standing.name], metric, units)
        for standing in standings
    }
    values = {
        name: np.array([math.nan if value is None else value for value in found.values[metric]])
        for name, found in seen.items()
        if found and not why[name]
    }
    standings = [
        dataclasses.replace(standing, held_out=_seen(seen[standing.name], metric), public=_public(standing, metric))
        for standing in standings
    ]
    buildings, public_units = place
    ordered = tuple(_in_order(standings, why, metric))
    return Board(task, metric, walks, ordered, values, buildings, public_units, units)


def _held_out(standing: Standing, metric: str) -> HeldOut | None:
    """Scores on the held-out walks of the present round; None where there are none."""
    entry = standing.entry
    found = None if entry.verification is None else entry.verification.held_out
    is_present = found is not None and found.round == find_suite(entry.suite).round_of(entry.env)
    return found if is_present and found is not None and metric in found.values else None


def _seen(found: HeldOut | None, metric: str) -> dict[str, Any]:
    """`Standing.held_out`."""
    if found is None:
        return {}
    values = [math.nan if value is None else value for value in found.values[metric]]
    return _summary(values, [str(unit) for unit in found.units], metric)


def _public(standing: Standing, metric: str) -> dict[str, Any]:
    """`Standing.public`."""
    unit = {result.walk: of.unit for result, of in zip(standing.entry.results, standing.scored, strict=True)}
    values = values_by_walk(metric, standing.entry.results, standing.scored)
    return _summary([*values.values()], [*unit.values()], metric)


def _summary(values: Sequence[float], units: Sequence[str], metric: str) -> dict[str, Any]:
    """Mean over walks with its interval; empty where no walk has the metric."""
    array = np.asarray(values)
    present = array[~np.isnan(array)]
    if not len(present):
        return {}
    low, high = mean_interval(array, units, scale=METRICS[metric].scale)
    ends = {"low": float(low), "high": float(high)} if math.isfinite(low) else {"low": None, "high": None}
    return {"value": float(present.mean()), "unit": METRICS[metric].unit, **ends, "n": len(present)}


def ranking_metric(rows: Sequence[Mapping[str, Any]]) -> str:
    """The metric that ranks an environment.

    The third quartile with penalties for wrong levels, but for the closure of the loop where the one place that is
    scored is where the walk began: there, a localizer that never moves has no error.
    """
    scored = [row["metrics"] for row in rows if row["metrics"].get("n", {}).get("value") is not None]
    one_place = bool(scored) and all(metrics["n"]["value"] == 1 for metrics in scored)
    closes = any(metrics.get(LOOP_RANKING, {}).get("n") for metrics in scored)
    return LOOP_RANKING if one_place and closes else RANKING


def _by_walk(
    frame: pd.DataFrame, metric: str, task: Task
) -> tuple[tuple[str, ...], dict[str, FloatArray], list[tuple[str, ...]]]:
    """Walks in the order of the split, values of each by localizer, buildings and units."""
    present = set(frame["walk"])
    walks = tuple(walk for walk in task.walks.get("test", ()) if walk in present)
    wide = frame.pivot_table(index="walk", columns="localizer", values=metric, aggfunc="mean", dropna=False)
    wide = wide.reindex(index=list(walks), columns=list(dict.fromkeys(frame["localizer"])))
    place = frame.drop_duplicates("walk").set_index("walk").loc[list(walks)]
    values = {str(name): wide[name].to_numpy(np.float64) for name in wide.columns}
    return walks, values, [tuple(map(str, place[name])) for name in ("building", "unit")]


def _in_order(standings: Sequence[Standing], why: Mapping[str, str], metric: str) -> Iterator[Standing]:
    """Ranked ones, best first, each with the rank of its division; then the others by public value."""
    sign = -1.0 if METRICS[metric].better == "higher" else 1.0
    ordered = [
        (standing.row["division"], sign * standing.held_out["value"], standing)
        for standing in sorted(standings, key=lambda standing: standing.name)
        if not why[standing.name]
    ]
    for division, value, standing in sorted(ordered, key=lambda item: item[1]):
        rank = 1 + sum(other == division and better < value for other, better, _ in ordered)
        yield dataclasses.replace(standing, rank=rank)

    def public(standing: Standing) -> tuple[bool, float, str]:
        found = standing.public
        chose = "declined" in why[standing.name] or not found
        return chose, sign * found["value"] if found else 0.0, standing.name

    for standing in sorted((standing for standing in standings if why[standing.name]), key=public):
        yield dataclasses.replace(standing, why_unranked=why[standing.name])


def _why_unranked(standing: Standing, values: FloatArray, metric: str) -> str:
    """Why an entry has no place in the order, as far as its public walks and its tier say."""
    missing = int(np.isnan(values).sum())
    if missing and standing.row["unsuitable"]:
        return f"declined {missing} of {len(values)} walks"
    if missing or not math.isfinite(standing.metric(metric)["value"]):
        return f"{metric} does not apply to {missing} of {len(values)} walks"
    if standing.entry.tier != VERIFIED:
        return f"{standing.entry.tier}, and only held-out walks rank"
    found = standing.entry.verification and standing.entry.verification.held_out
    if found and found.round != find_suite(standing.entry.suite).round_of(standing.entry.env):
        return "verified in an earlier round, whose held-out walks are public by now"
    return ""


def _why_not_comparable(found: HeldOut | None, metric: str, units: Sequence[int]) -> str:
    """Why a verified entry cannot be compared with the others on held-out walks."""
    if found is None or any(value is None for value in found.values[metric]):
        return f"{metric} does not apply to its held-out walks"
    if found.units != tuple(units):
        return f"verified on {len(found.units)} held-out walks, others on {len(units)}"
    return ""
