"""Who is ahead, by how much, and how sure that is: the submissions of one environment in their order."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np

from pdrbench.errors import ResultError
from pdrbench.evaluation.scoring import Scored
from pdrbench.evaluation.tables import DRAW_SEED, Results
from pdrbench.geometry import FloatArray
from pdrbench.metrics import METRICS
from pdrbench.metrics.statistics import Comparison, compare_pairs
from pdrbench.registry import make_task
from pdrbench.result import OFFLINE
from pdrbench.task import Task, no_radio_map

if TYPE_CHECKING:
    import pandas as pd

    from pdrbench_leaderboard.card import Card
    from pdrbench_leaderboard.entry import Entry

RANKING: Final = "p75_level_penalised_m"  # EvAAL: it ranks the leaderboards
LOOP_RANKING: Final = "loop_closure_pct"  # where nothing but the return to the start is scored: staying is no merit
SIGNIFICANT: Final = 0.05  # of p-values adjusted by Holm [R]
MAX_TESTED: Final = 100  # entries, from the first, that are tested in pairs: 4950 pairs, half a minute (ours)


@dataclass(frozen=True, slots=True)
class Standing:
    """One submission on its leaderboard."""

    entry: Entry  # what was submitted
    row: Mapping[str, Any]  # its line of `Results.rows()`: values and intervals by metric
    scored: tuple[Scored, ...]  # scores and errors of each of its results
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
        """Value, unit, interval and number of walks of one metric; empty where it does not apply."""
        found: Mapping[str, Any] = self.row["metrics"].get(name, {})
        return found if found.get("value") is not None else {}


@dataclass(frozen=True)
class Board:
    """The leaderboard of one environment."""

    task: Task
    metric: str  # name of the metric that ranks
    walks: tuple[str, ...]  # walks of the test split that an entry was scored on, in the order of the split
    standings: tuple[Standing, ...]  # ranked ones by value, then the others by name
    values: Mapping[str, FloatArray]  # (W,) by entry: the metric of each walk, mean over seeds; NaN where there is none
    buildings: tuple[str, ...]  # of each walk
    units: tuple[str, ...]  # of replication, of each walk

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
            survey_used=card.survey_used and self.task.radio_map is not no_radio_map,
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
            units=self.units,
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
        return bool(self.pairs) and 2.0 ** (1 - len(set(self.units))) * len(self.pairs) >= SIGNIFICANT


def make_board(entries: Sequence[Entry], jobs: int = 1) -> Board:
    """Scores the entries of one environment from their estimates and puts them into order.

    Args:
        entries: At least one, all of one environment, each with a name of its own.
        jobs: Processes that compute the scores.

    Raises:
        ResultError: Two entries have one name, or an entry was made on another version of the environment.
        DatasetError: The environment's recorded data is not found.
    """
    names = [entry.localizer for entry in entries]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ResultError(f"two entries of {entries[0].env} are called {twice!r}; rename one of them")
    task = make_task(entries[0].env)
    results = Results(tuple(itertools.chain.from_iterable(entry.results for entry in entries)), jobs)
    rows = results.rows()  # one for each entry, in their order
    metric = ranking_metric(rows)
    walks, values, place = _by_walk(results.walks(), metric, task)
    scored = iter(results.scored)
    standings = [
        Standing(entry, row, tuple(itertools.islice(scored, len(entry.results))))
        for entry, row in zip(entries, rows, strict=True)
    ]
    return Board(task, metric, walks, tuple(_in_order(standings, values, metric)), values, *place)


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


def _in_order(standings: Sequence[Standing], values: Mapping[str, FloatArray], metric: str) -> Iterator[Standing]:
    """Ranked ones, best first, each with the rank of its division; then the others."""
    sign = -1.0 if METRICS[metric].better == "higher" else 1.0
    why = {standing.name: _why_unranked(standing, values[standing.name], metric) for standing in standings}
    ordered = [
        (standing.row["division"], sign * standing.metric(metric)["value"], standing)
        for standing in sorted(standings, key=lambda standing: standing.name)
        if not why[standing.name]
    ]
    for division, value, standing in sorted(ordered, key=lambda item: item[1]):
        rank = 1 + sum(other == division and better < value for other, better, _ in ordered)
        yield dataclasses.replace(standing, rank=rank)
    for standing in sorted(standings, key=lambda standing: standing.name):
        if why[standing.name]:
            yield dataclasses.replace(standing, why_unranked=why[standing.name])


def _why_unranked(standing: Standing, values: FloatArray, metric: str) -> str:
    """Why an entry has no place in the order: one that chooses its walks is not compared."""
    missing = int(np.isnan(values).sum())
    if not missing and math.isfinite(standing.metric(metric)["value"]):
        return ""
    if standing.row["unsuitable"]:
        return f"declined {missing} of {len(values)} walks"
    return f"{metric} does not apply to {missing} of {len(values)} walks"
