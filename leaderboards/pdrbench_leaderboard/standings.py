"""Who is first on a board, by how much, and how sure that is.

Held-out walks and replays of recorded ones rank; public walks stand beside. Failing or declining a walk never helps:
the worst answer that any entry has there counts instead.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from pdrbench.errors import BundleError
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.metrics.ranking import Ranking, Standing, rank
from pdrbench.metrics.statistics import DRAWS, MIN_UNITS, unit_codes
from pdrbench.metrics.table import METRICS
from pdrbench.result import ONLINE
from pdrbench_leaderboard.boards import P75, PARTS, PRIVATE, Board, BoardEnvironment, Part
from pdrbench_leaderboard.card import Card
from pdrbench_leaderboard.record import (
    DivisionRecord,
    EntryRecord,
    PartWalks,
    is_verified,
    list_entries,
    numbers,
    read_entry,
    read_walks,
)
from pdrbench_leaderboard.score import QUANTILES

RANKING: Final = "p75_m"
MIN_SCORE: Final = 1e-6  # no walk counts as better, by a metric that is no length
SPLITS: Final = 20  # of the units into halves
DRAW_SEED: Final = 0  # the same results give the same p-values
DIVISIONS: Final = ("online", "offline")


@dataclass(frozen=True)
class Entry:
    """An entry of a board with what is known of it."""

    record: EntryRecord
    card: Card
    folder: Path

    @property
    def name(self) -> str:
        """What it is called on the board."""
        return self.record.name

    def division(self, walks: PartWalks, division: str) -> DivisionRecord | None:
        """How it did on the present walks of a part; None where it has not played them. Raises `BundleError`."""
        parts = [of for of in self.record.parts if of.place == (walks.env, walks.part)]
        known = [of for part in parts if part.walks_sha256 == walks.sha256 for of in part.divisions]
        found = next((of for of in known if of.division == division), None)
        if found is not None and len(found.statuses) != len(walks.walks):
            raise BundleError(f"{self.name}: {len(found.statuses)} of {len(walks.walks)} walks of {walks.env}")
        return found


@dataclass(frozen=True)
class Row:
    """One entry in one division of a board.

    Attributes:
        entry: Of which it is.
        standing: Rank, score and ratio to the best.
        mean_m: Mean over environments of the mean error of their walks.
        p75_m: Third quartile of the level-penalised error over all moments together, EvAAL's figure.
        p95_m: 95th percentile likewise.
        lost: Fraction of walks whose third quartile is above the board's bound, or that were not played to their end.
        coverage: Mean over walks of the fraction of moments in the claimed disc of 95 %; NaN where none was claimed.
        outside_pct: Mean over walks of the fraction of answers outside of the walkable floor.
        found_s: Median over walks of the time to the first answer within 5 m.
        load: Mean over walks of processor time over the time of the walk.
        public_m: Score on public walks, NaN where there are none.
        private_ratio: Score on private recordings over that on walks whose truth is public, geometric mean over the
            environments that have both; NaN where there are none.
        by_env: Score on each environment.
    """

    entry: Entry
    standing: Standing
    mean_m: float
    p75_m: float
    p95_m: float
    lost: float
    coverage: float
    outside_pct: float
    found_s: float
    load: float
    public_m: float
    private_ratio: float
    by_env: Mapping[str, float]

    @property
    def name(self) -> str:
        """Of its entry."""
        return self.entry.name

    @property
    def is_complete(self) -> bool:
        """Whether it played every walk to its end."""
        return self.standing.walks == self.standing.of


@dataclass(frozen=True)
class Table:
    """One division of a board."""

    board: Board
    division: str
    walks: Mapping[tuple[str, Part], PartWalks]
    entries: tuple[Entry, ...]

    def environments(self, part: Part = "held-out") -> list[BoardEnvironment]:
        """Those of which walks were played."""
        return [listed for listed in self.board.environments if (listed.env, part) in self.walks]

    @functools.cached_property
    def is_lost(self) -> bool:
        """Whether nothing says where the walks begin."""
        return all(listed.is_lost for listed in self.environments())

    def divisions(self, entry: Entry, part: Part = "held-out") -> dict[str, DivisionRecord]:
        """How an entry did, by environment; online where it did not revise."""
        found = {}
        for listed in self.environments(part):
            walks = self.walks[listed.env, part]
            of = entry.division(walks, self.division) or entry.division(walks, ONLINE)
            if of is not None:
                found[listed.env] = of
        return found

    def values(self, entry: Entry, name: str = RANKING, part: Part = "held-out") -> dict[str, FloatArray]:
        """(W,) values of a metric by environment; raises `BundleError` where they are not kept."""
        found = self.divisions(entry, part)
        if any(name not in of.values for of in found.values()):
            raise BundleError(f"{entry.name} has no {name}: play it anew with `pdrbench leaderboard run`")
        return {env: numbers(of.values[name]) for env, of in found.items()}

    @property
    def ranked_by(self) -> str:
        """What the metric that ranks is called in an entry."""
        return RANKING if self.board.metric == P75 else self.board.metric

    @functools.cached_property
    def ranking(self) -> Ranking | None:
        """On held-out walks; None where there are none."""
        return self.ranked("held-out")

    @functools.cached_property
    def public(self) -> Ranking | None:
        """On public walks."""
        return self.ranked("public", draws=0)

    def ranked(
        self, part: Part, group: str | None = None, envs: Collection[str] | None = None, *, draws: int = DRAWS
    ) -> Ranking | None:
        """Order on one part, or on one stratum or some environments of it; None where nothing was played there."""
        keep = {
            listed.env: np.array([group is None or group in walk.groups for walk in self.walks[listed.env, part].walks])
            for listed in self.environments(part)
            if envs is None or listed.env in envs
        }
        return self._ranked(part, keep, draws)

    def _ranked(self, part: Part, keep: Mapping[str, BoolArray], draws: int = DRAWS) -> Ranking | None:
        """Order on some walks of a part."""
        keep = {name: of for name, of in keep.items() if of.any()}
        values = {
            entry.name: {
                name: of[keep[name]] for name, of in self.values(entry, self.ranked_by, part).items() if name in keep
            }
            for entry in self.entries
        }
        if not any(np.isfinite(of).any() for by_env in values.values() for of in by_env.values()):
            return None
        units = {
            name: [walk.unit for walk, kept in zip(self.walks[name, part].walks, of, strict=True) if kept]
            for name, of in keep.items()
        }
        floor = {name: self.board.environment(name).noise_m for name in keep}
        if METRICS[self.board.metric].unit != "m":
            floor = dict.fromkeys(keep, MIN_SCORE)
        return rank(values, units=units, noise_m=floor, rng=np.random.default_rng(DRAW_SEED), draws=draws)

    @functools.cached_property
    def rows(self) -> tuple[Row, ...]:
        """Best first."""
        if self.ranking is None:
            return ()
        public = {} if self.public is None else {of.name: of.score_m for of in self.public.standings}
        by_env = {
            listed.env: {of.name: of.score_m for of in ranking.standings}
            for listed in self.environments()
            if (ranking := self.ranked("held-out", envs={listed.env}, draws=0)) is not None
        }
        entries = {entry.name: entry for entry in self.entries}
        ratios = self.private_ratios
        return tuple(self._row(entries[of.name], of, public, by_env, ratios) for of in self.ranking.standings)

    def _row(
        self,
        entry: Entry,
        standing: Standing,
        public: Mapping[str, float],
        by_env: Mapping[str, Mapping[str, float]],
        private_ratios: Mapping[str, float],
    ) -> Row:
        played = {name: self.values(entry, name) for name in ("mean_m", "coverage", "outside_pct", "found_s", "load")}
        p75, p95 = pooled(list(self.divisions(entry).values()), (0.75, 0.95))
        p75_m = np.concatenate(list(self.values(entry).values()))
        lost = 1.0 - float((p75_m <= self.board.lost_m).sum()) / standing.of
        return Row(
            entry=entry,
            standing=standing,
            mean_m=mean_of([mean_of(of) for of in played["mean_m"].values()]),
            p75_m=p75,
            p95_m=p95,
            lost=lost,
            coverage=mean_of(np.concatenate(list(played["coverage"].values()))),
            outside_pct=mean_of(np.concatenate(list(played["outside_pct"].values()))),
            found_s=_median(np.concatenate(list(played["found_s"].values()))),
            load=mean_of(np.concatenate(list(played["load"].values()))),
            public_m=public.get(entry.name, math.nan),
            private_ratio=private_ratios.get(entry.name, math.nan),
            by_env={env: of[entry.name] for env, of in by_env.items() if entry.name in of},
        )

    @functools.cached_property
    def private_ratios(self) -> dict[str, float]:
        """How much worse each entry is on private recordings than on walks like them whose truth is public."""
        found: dict[str, list[float]] = {}
        for listed in self.environments(PRIVATE):
            private, known = (self.ranked(part, envs={listed.env}, draws=0) for part in (PRIVATE, listed.open_part))
            known_m = {} if known is None else {of.name: of.score_m for of in known.standings}
            for of in private.standings if private is not None else ():
                if of.name in known_m:
                    found.setdefault(of.name, []).append(of.score_m / known_m[of.name])
        return {name: float(np.exp(np.mean(np.log(of)))) for name, of in found.items()}

    @property
    def num_pairs(self) -> int:
        """Of ranked entries."""
        return len(self.rows) * (len(self.rows) - 1) // 2

    @property
    def num_apart(self) -> int:
        """Pairs that are separated."""
        return 0 if self.ranking is None else int(np.triu(self.ranking.pairs.is_apart, 1).sum())

    @functools.cached_property
    def by_group(self) -> dict[str, dict[str, float]]:
        """Score of each entry by stratum of the held-out walks, in alphabetical order."""
        of_parts = [of.walks for of in self.walks.values() if of.part == "held-out"]
        names = sorted({name for walks in of_parts for walk in walks for name in walk.groups})
        rankings = {name: self.ranked("held-out", group=name, draws=0) for name in names}
        return {name: {of.name: of.score_m for of in one.standings} for name, one in rankings.items() if one}

    @functools.cached_property
    def agreement(self) -> tuple[float, float]:
        """Kendall's tau of the orders on public and on held-out walks: over pairs separated, and over all.

        Of environments that have both, on whose held-out walks pairs are separated. NaN where there is no such pair.
        """
        held_out = self.ranked("held-out", envs={listed.env for listed in self.environments("public")})
        return tau(held_out, self.public, held_out)

    @functools.cached_property
    def halves_agree(self) -> tuple[float, float]:
        """Kendall's tau of the orders on two random halves of the units, as `agreement`: mean over `SPLITS`."""
        found = []
        for first in self._halves:
            second = {name: ~of for name, of in first.items()}
            one, other = (self._ranked("held-out", keep, draws=0) for keep in (first, second))
            found.append(tau(one, other, self.ranking))
        return mean_of([of[0] for of in found]), mean_of([of[1] for of in found])

    @functools.cached_property
    def generated_agrees(self) -> tuple[float, float, float]:
        """Kendall's tau of the orders on generated and on recorded walks, and its range on random halves of the units.

        NaN where a board has only one of both.
        """
        generated = {listed.env for listed in self.environments() if listed.is_generated}
        recorded = {listed.env for listed in self.environments()} - generated
        if not generated or not recorded:
            return (math.nan,) * 3
        found = []
        for keep in ({}, *self._halves):
            one, other = (
                self._ranked("held-out", {name: keep[name] for name in envs}, draws=0)
                if keep
                else self.ranked("held-out", envs=envs, draws=0)
                for envs in (generated, recorded)
            )
            found.append(tau(one, other, self.ranking)[1])
        return found[0], min(found[1:]), max(found[1:])

    @functools.cached_property
    def _halves(self) -> list[dict[str, BoolArray]]:
        """Random halves of the units of each environment, as `rank` has them: whether a walk is in the first."""
        rng, found = np.random.default_rng(DRAW_SEED), []
        for _ in range(SPLITS):
            first = {}
            for listed in self.environments():
                units = [walk.unit for walk in self.walks[listed.env, "held-out"].walks]
                code = unit_codes(units, len(units)) if len(set(units)) >= MIN_UNITS else np.arange(len(units))
                chosen = rng.permutation(np.unique(code))
                first[listed.env] = np.isin(code, chosen[: len(chosen) // 2])
            found.append(first)
        return found


def tau(one: Ranking | None, other: Ranking | None, tested: Ranking | None) -> tuple[float, float]:
    """Kendall's tau of two orders: over pairs separated by `tested`, and over all.

    NaN where there is no such pair.
    """
    if one is None or other is None or tested is None:
        return math.nan, math.nan
    first, second = ({of.name: number for number, of in enumerate(ranking.standings)} for ranking in (one, other))
    names = [of.name for of in tested.standings]
    known = [row for row, name in enumerate(names) if name in first and name in second]
    pairs = [(i, j) for j in known for i in known if i < j]
    signs = np.array(
        [
            1.0 if (first[names[i]] < first[names[j]]) == (second[names[i]] < second[names[j]]) else -1.0
            for i, j in pairs
        ]
    )
    apart = np.array([bool(tested.pairs.is_apart[i, j]) for i, j in pairs], bool)
    return mean_of(signs[apart]), mean_of(signs)


def pooled(divisions: Sequence[DivisionRecord], quantiles: Sequence[float]) -> list[float]:
    """Quantiles of the error over all moments of some parts together, from those of each."""
    parts = [of for of in divisions if of.quantiles_m]
    if not parts:
        return [math.nan] * len(quantiles)
    edges_m = np.unique(np.concatenate([of.quantiles_m for of in parts]))
    total = sum(of.moments for of in parts)
    share = sum(of.moments / total * np.interp(edges_m, of.quantiles_m, QUANTILES) for of in parts)
    return [float(np.interp(quantile, share, edges_m)) for quantile in quantiles]


def read_tables(root: Path, board: Board) -> list[Table]:
    """Both divisions of a board; none where nothing was played."""
    walks = read_walks(root / board.name)
    entries = [Entry(*read_entry(folder), folder) for folder in list_entries(root, board.name)]
    places = [(listed.env, part) for listed in board.environments for part in PARTS]
    walks = {place: walks[place] for place in places if place in walks}
    verified = [entry for entry in entries if is_verified(entry.folder, entry.record)]
    tables = []
    for division in DIVISIONS:
        here = tuple(
            entry for entry in verified if any(entry.division(of, division) is not None for of in walks.values())
        )
        if here:
            tables.append(Table(board, division, walks, here))
    return tables


def mean_of(values: Sequence[float] | FloatArray) -> float:
    """Of the values that are not NaN; NaN where there are none."""
    array = np.asarray(values, dtype=np.float64)
    known = array[~np.isnan(array)]
    return float(known.mean()) if len(known) else math.nan


def _median(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(np.sort(known)[(len(known) - 1) // 2]) if len(known) else math.nan
