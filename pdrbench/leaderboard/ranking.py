"""Who is ahead, by how much, and how sure that is: the submissions of one environment in their order."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pdrbench.errors import ResultError
from pdrbench.evaluation.scoring import Scored
from pdrbench.evaluation.tables import DRAW_SEED, Results
from pdrbench.geometry import FloatArray
from pdrbench.metrics import METRICS
from pdrbench.metrics.statistics import Comparison, compare_pairs
from pdrbench.registry import make_task
from pdrbench.result import OFFLINE, Result
from pdrbench.task import Task, no_radio_map

if TYPE_CHECKING:
    import pandas as pd

    from pdrbench.leaderboard.entry import Entry

RANKING: Final = "p75_level_penalised_m"  # EvAAL: it ranks the leaderboards
LOOP_RANKING: Final = "loop_closure_pct"  # where nothing but the return to the start is scored: staying is no merit
SIGNIFICANT: Final = 0.05  # of p-values adjusted by Holm [R]
MAX_TESTED: Final = 100  # entries, from the first, that are tested in pairs: 4950 pairs, half a minute (ours)


@dataclass(frozen=True, slots=True)
class Standing:
    """One submission on its leaderboard.

    Attributes:
        entry: What was submitted.
        row: Its line of `Results.rows()`: values and intervals by metric.
        results: Its answers, under the entry's name.
        scored: Scores and errors of each of them.
        rank: Within its division, 1 is first, equal values share a rank; None where it is not ranked.
        why_unranked: Empty where it is.
    """

    entry: Entry
    row: Mapping[str, Any]
    results: tuple[Result, ...]
    scored: tuple[Scored, ...]
    rank: int | None = None
    why_unranked: str = ""

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


@dataclass(frozen=True, slots=True)
class Used:
    """What an entry uses of what its environment offers.

    Attributes:
        sensors: In the order of its card.
        map: Whether it uses the building.
        survey: Whether it uses the radio survey.
    """

    sensors: tuple[str, ...]
    map: bool
    survey: bool


@dataclass(frozen=True)
class Board:
    """The leaderboard of one environment.

    Attributes:
        task: The environment.
        metric: Name of the metric that ranks.
        walks: Walks of the test split that an entry was scored on, in the order of the split.
        standings: Ranked ones by value, then the others by name.
        values: (W,) by entry: the metric of each walk, mean over seeds; NaN where there is none.
        buildings: Of each walk.
    """

    task: Task
    metric: str
    walks: tuple[str, ...]
    standings: tuple[Standing, ...]
    values: Mapping[str, FloatArray]
    buildings: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.standings)

    @property
    def ranked(self) -> tuple[Standing, ...]:
        """Those that have a rank."""
        return tuple(standing for standing in self.standings if standing.rank is not None)

    def used(self, standing: Standing) -> Used:
        """What the card of an entry names and this environment has: a card speaks of all environments at once."""
        card = standing.entry.card
        offered = {spec.name for spec in self.task.sensors}
        return Used(
            sensors=tuple(name for name in card.sensors_used if name in offered),
            map=card.map_used and any(self.buildings),
            survey=card.survey_used and self.task.radio_map is not no_radio_map,
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
            strata=self.buildings,
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
        """Whether no difference at all could be significant: too few walks for so many pairs."""
        return bool(self.pairs) and 2.0 ** (1 - len(self.walks)) * len(self.pairs) >= SIGNIFICANT


def make_board(entries: Sequence[Entry], jobs: int = 1) -> Board:
    """Scores the entries of one environment from their estimates and puts them into order.

    Args:
        entries: At least one, all of one environment, each with a name of its own.
        jobs: Processes that compute the scores.

    Raises:
        ResultError: Two entries have one name, or an entry was made on another version of the environment.
        DatasetError: The environment's recorded data is not found.
    """
    _check_names(entries)
    task = make_task(entries[0].env)
    named = [
        dataclasses.replace(result, localizer=entry.localizer)
        for entry in entries
        for result in entry.results
        if result.split == "test"  # held-out walks stand on the entry's own page
    ]
    results = Results(tuple(named), jobs)
    rows = {row["localizer"]: row for row in results.rows()}
    frame = results.walks()
    metric = ranking_metric(tuple(rows.values()))
    walks, values, buildings = _by_walk(frame, metric, task)
    of_entry = _grouped(results)
    standings = [
        Standing(entry, rows[entry.localizer], *of_entry[entry.localizer])
        for entry in entries
        if entry.localizer in rows
    ]
    return Board(task, metric, walks, tuple(_in_order(standings, values, metric)), values, buildings)


def ranking_metric(rows: Sequence[Mapping[str, Any]]) -> str:
    """The metric that ranks an environment.

    The third quartile with penalties for wrong levels, but for the closure of the loop where the one place that is
    scored is where the walk began: there, who never moves has no error.
    """
    scored = [row["metrics"] for row in rows if row["metrics"].get("n", {}).get("value") is not None]
    one_place = bool(scored) and all(metrics["n"]["value"] == 1 for metrics in scored)
    closes = any(metrics.get(LOOP_RANKING, {}).get("n") for metrics in scored)
    return LOOP_RANKING if one_place and closes else RANKING


def _check_names(entries: Sequence[Entry]) -> None:
    names = [entry.localizer for entry in entries]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ResultError(f"two entries of {entries[0].env} are called {twice!r}; rename one of them")


def _by_walk(
    frame: pd.DataFrame, metric: str, task: Task
) -> tuple[tuple[str, ...], dict[str, FloatArray], tuple[str, ...]]:
    """Walks in the order of the split, values of each by localizer, and buildings."""
    present = set(frame["walk"])
    walks = tuple(walk for walk in task.walks.get("test", ()) if walk in present)
    wide = frame.pivot_table(index="walk", columns="localizer", values=metric, aggfunc="mean", dropna=False)
    wide = wide.reindex(index=list(walks), columns=list(dict.fromkeys(frame["localizer"])))
    building = frame.drop_duplicates("walk").set_index("walk")["building"]
    values = {str(name): wide[name].to_numpy(np.float64) for name in wide.columns}
    return walks, values, tuple(str(building[walk]) for walk in walks)


def _grouped(results: Results) -> dict[str, tuple[tuple[Result, ...], tuple[Scored, ...]]]:
    groups: dict[str, list[tuple[Result, Scored]]] = {}
    for result, scored in zip(results.results, results.scored, strict=True):
        groups.setdefault(result.localizer, []).append((result, scored))
    return {name: (tuple(r for r, _ in group), tuple(s for _, s in group)) for name, group in groups.items()}


def _in_order(standings: Sequence[Standing], values: Mapping[str, FloatArray], metric: str) -> Iterator[Standing]:
    """Ranked ones, best first, each with the rank of its division; then the others."""
    sign = -1.0 if METRICS[metric].better == "higher" else 1.0
    why = {standing.name: _why_unranked(standing, values[standing.name], metric) for standing in standings}
    comparable = [standing for standing in standings if not why[standing.name]]
    ordered = sorted(comparable, key=lambda standing: (sign * standing.metric(metric)["value"], standing.name))
    ranks: dict[str, int] = {}
    for division in dict.fromkeys(standing.row["division"] for standing in ordered):
        ranks |= _ranks([standing for standing in ordered if standing.row["division"] == division], metric)
    for standing in ordered:
        yield dataclasses.replace(standing, rank=ranks[standing.name])
    for standing in sorted(standings, key=lambda standing: standing.name):
        if why[standing.name]:
            yield dataclasses.replace(standing, why_unranked=why[standing.name])


def _ranks(ordered: Sequence[Standing], metric: str) -> dict[str, int]:
    """Rank by name; equal values share the rank of the first of them."""
    ranks: dict[str, int] = {}
    groups = itertools.groupby(ordered, key=lambda standing: standing.metric(metric)["value"])
    for _, group in groups:
        ranks |= dict.fromkeys((standing.name for standing in list(group)), len(ranks) + 1)
    return ranks


def _why_unranked(standing: Standing, values: FloatArray, metric: str) -> str:
    """Why an entry has no place in the order: one that chooses its walks is not compared."""
    missing = int(np.isnan(values).sum())
    if not missing and math.isfinite(standing.metric(metric)["value"]):
        return ""
    if standing.row["unsuitable"]:
        return f"declined {missing} of {len(values)} walks"
    return f"{metric} does not apply to {missing} of {len(values)} walks"
