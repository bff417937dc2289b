"""Many results as tables: scores by walk, means over walks with intervals, paired comparisons; read from a folder."""

from __future__ import annotations

import functools
import json
import math
import re
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pdrbench.errors import PdrbenchError, ResultError, unknown_name
from pdrbench.evaluation import store
from pdrbench.evaluation.number_text import NOTHING, decimals
from pdrbench.evaluation.scoring import Scored, score_all
from pdrbench.evaluation.summary import Row, finite, summary_row
from pdrbench.evaluation.wording import (
    BEHIND,
    RANKING,
    SHOWN,
    behind_cells,
    counted,
    describe_interval,
    describe_offline,
    machine_text,
    shown_besides,
    strata_cells,
)
from pdrbench.geometry import FloatArray
from pdrbench.metrics import METRICS
from pdrbench.metrics.statistics import (
    TESTS,
    compare_pairs,
)
from pdrbench.registry import make_task
from pdrbench.result import OFFLINE, Result, shown_name

if TYPE_CHECKING:
    import pandas as pd

IDENTITY: Final = ("env", "localizer", "split", "walk", "seed")


# What has to agree for results of one localizer on one environment to belong in one row.
VARIANT: Final = (*("files_sha256", "environment", "localizer_sha256", "parameters", "budget", "versions", "nonce"),)
DRAW_SEED: Final = 0  # the same results give the same intervals


@dataclass(frozen=True)
class Results:
    """What came of a sweep; scores are computed when they are first asked for.

    Attributes:
        results: In the order of environments, walks, localizers, seeds.
        jobs: Processes that compute the scores.
        secret: Behind the walks, where they are held out.
        kept: Folder where scores are kept, as `score_all` takes it.
    """

    results: tuple[Result, ...]
    jobs: int = 1
    secret: str | None = field(default=None, repr=False)
    kept: Path | None = None

    def __len__(self) -> int:
        return len(self.results)

    def __repr__(self) -> str:
        counts = Counter(result.status for result in self.results)
        return f"Results({', '.join(f'{count} {status}' for status, count in counts.items()) or 'none'})"

    @functools.cached_property
    def scored(self) -> tuple[Scored, ...]:
        """Scores of each result."""
        return tuple(score_all(self.results, self.jobs, self.secret, self.kept))

    def walks(self) -> pd.DataFrame:
        """One row for each environment, localizer, walk and seed, with every metric; NaN where it does not apply."""
        import pandas as pd

        rows = [
            {name: getattr(result, name) for name in IDENTITY}
            | {"status": result.status, "division": result.division, "building": scored.building, "unit": scored.unit}
            | {name: scored.scores.get(name, math.nan) for name in METRICS}
            for result, scored in zip(self.results, self.scored, strict=True)
        ]
        return pd.DataFrame(rows, columns=[*IDENTITY, "status", "division", "building", "unit", *METRICS])

    def rows(self) -> list[dict[str, Any]]:
        """The summary as `compare --json` prints it: one entry for each environment, split and localizer.

        `value` is the mean over walks of the mean over seeds, or the median of the median where the metric says so;
        `low` and `high` bound its 95 % interval by the spread of whole units (`metrics.statistics.mean_interval`), None
        below four; `units` and `unit_kind` say of how many of what. `n` is the number of walks that have the metric,
        `served` that of the walks that were not declined. Names with `pooled_` are over all positions of all walks and
        seeds together. What does not apply is None; so is a time that is infinite, which `n` shows: a value that is
        None for more than 0 walks.

        `strata` holds the same of parts of the results: walks of one of the task's groups (`by` "group"), places by
        their distance to the nearest scan of a recorded survey ("radio"); `declined` counts runs that were declined.

        `division` is "offline" where estimates of any walk were revised when it was over; `revise_s` is the mean wall
        time which that took, None where it was not done.

        `behind` is the difference of `p75_level_penalised_m` from the localizer where that is smallest (`best`), on the
        same walks and seeds: value and interval as `pairs` has them, `p_holm` its p-value; None where there is none.
        """
        return [finite(row) for row in self._rows]

    @functools.cached_property
    def _rows(self) -> list[dict[str, Any]]:
        groups: dict[tuple[str, str, str], list[tuple[Result, Scored]]] = {}
        for result, scored in zip(self.results, self.scored, strict=True):
            groups.setdefault((result.env, result.split, result.localizer), []).append((result, scored))
        rows = [summary_row(group, make_task(group[0][0].task)) for group in groups.values()]
        return [{**row, "behind": behind} for row, behind in zip(rows, self._behind(rows), strict=True)]

    def _behind(self, rows: Sequence[Row]) -> list[dict[str, Any] | None]:
        """How far each localizer is behind the best of its environment and split."""
        best: dict[tuple[str, str], tuple[float, str]] = {}
        for row in rows:
            if (score := row["metrics"].get(RANKING, {}).get("value")) is not None:
                place = (row["env"], row["split"])
                best[place] = min(best.get(place, (math.inf, "")), (score, row["localizer"]))
        found: dict[tuple[str, str, str], dict[str, Any]] = {}
        for pair in self.pairs(RANKING).to_dict("records") if len(rows) > len(best) else ():
            env, split = place = (pair["env"], pair["split"])
            first, second = pair["first"], pair["second"]
            leader = best.get(place, (0.0, ""))[1]
            if leader not in (first, second) or not pair["num_walks"]:
                continue
            ends = [pair["effect"], pair["low"], pair["high"]]
            if leader == first:
                ends = [-end for end in (ends[0], ends[2], ends[1])]
            value, low, high = (None if math.isnan(end) else end for end in ends)
            p_holm = None if math.isnan(pair["p_holm"]) else pair["p_holm"]
            entry = {"best": leader, "value": value, "low": low, "high": high, "n": pair["num_walks"], "p_holm": p_holm}
            found[env, split, second if leader == first else first] = entry
        leaders = {(*place, leader): {"best": leader} for place, (_, leader) in best.items()}
        return [(leaders | found).get((row["env"], row["split"], row["localizer"])) for row in rows]

    def frame(self) -> pd.DataFrame:
        """The summary, one line for each environment, split, localizer and metric; infinite is what never happened."""
        import pandas as pd

        columns = ["env", "localizer", "split", "walks", "stratum", "metric"]
        columns += ["value", "unit", "low", "high", "n", "division"]
        lines = [
            {name: row[name] for name in ("env", "localizer", "split", "walks", "division")}
            | {"stratum": name, "metric": metric, **entry}
            for row in self._rows
            for name, part in (("", row), *((of["name"], of) for of in row["strata"]))
            for metric, entry in part["metrics"].items()
        ]
        frame = pd.DataFrame(lines, columns=columns)
        return frame.astype(dict.fromkeys(("value", "low", "high"), np.float64))

    def pairs(self, metric: str = "mean_m", *, test: str = "sign-flip") -> pd.DataFrame:
        """Every two localizers on the same walks and seeds, for each environment and split.

        Args:
            metric: Of `METRICS`.
            test: "sign-flip" or "wilcoxon"; p-values are adjusted by Holm within each environment and split.

        Returns:
            env, split, metric, and the fields of `metrics.statistics.Comparison`.
        """
        import pandas as pd

        if metric not in METRICS:
            raise unknown_name("metric", metric, METRICS)
        better = METRICS[metric].better
        if better == "none":
            raise PdrbenchError(f"{metric} is neither better when low nor when high: there is nothing to compare")
        if METRICS[metric].over_walks != "mean":
            raise PdrbenchError(
                f"{metric} may be infinite, and infinite times have no differences; compare a share, as converged_60s"
            )
        if test not in TESTS:
            raise unknown_name("paired test", test, TESTS)
        found = []
        for (env, split), walks in self.walks().groupby(["env", "split"], sort=False):
            values, units = _side_by_side(walks, metric)
            rng = np.random.default_rng(DRAW_SEED)
            for pair in compare_pairs(values, rng=rng, units=units, better=better, test=test):
                found.append({"env": env, "split": split, "metric": metric} | asdict(pair))
        return pd.DataFrame(found)

    def table(self) -> str:
        """Plain text: one line for each environment, split and localizer, and what to know when reading it."""
        text = []
        for header, lines in self._tables():
            widths = [max(len(line[column]) for line in [header, *lines]) for column in range(len(header))]
            rule = ["-" * width for width in widths]
            padded = [[cell.ljust(w) for cell, w in zip(line, widths, strict=True)] for line in (header, rule, *lines)]
            text += [*("  ".join(line).rstrip() for line in padded), ""]
        return "\n".join([*text, *self._notes()])

    def to_markdown(self) -> str:
        """The tables in Markdown."""
        text = []
        for header, lines in self._tables():
            table = [header, [":--"] * NUM_NAMES + ["--:"] * (len(header) - NUM_NAMES), *lines]
            text += ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in table] + [""]
        return "\n".join([*text, *(f"* {note}" for note in self._notes()), ""])

    def to_latex(self) -> str:
        """The tables in LaTeX, for the package booktabs."""
        text = []
        for header, lines in self._tables():
            text += [
                rf"\begin{{tabular}}{{{'l' * NUM_NAMES}{'r' * (len(header) - NUM_NAMES)}}}",
                r"\toprule",
                " & ".join(_latex(cell) for cell in header) + r" \\",
                r"\midrule",
                *(" & ".join(_latex(cell) for cell in line) + r" \\" for line in lines),
                r"\bottomrule",
                r"\end{tabular}",
            ]
        return "\n".join([*text, *(f"% {note}" for note in self._notes()), ""])

    def to_csv(self, path: Path | str | None = None) -> str:
        """`frame` as CSV; also written to `path` where one is given."""
        return _written(str(self.frame().to_csv(index=False)), path)

    def to_json(self, path: Path | str | None = None) -> str:
        """`{"rows": rows()}` as JSON; also written to `path` where one is given."""
        return _written(json.dumps({"rows": self.rows()}, indent=2, allow_nan=False) + "\n", path)

    def _tables(self) -> list[tuple[list[str], list[list[str]]]]:
        """The summary, and for each environment and split with strata another table."""
        by_split: dict[tuple[str, str], list[Row]] = {}
        for row in self._played:
            by_split.setdefault((row["env"], row["split"]), []).append(row)
        found = [self._cells()]
        for (env, split), rows in by_split.items():
            header, lines = strata_cells(rows, _cell)
            if lines:
                found.append((["env", "split", *header], [[env, split, *line] for line in lines]))
        return found

    @property
    def _played(self) -> list[dict[str, Any]]:
        """Rows of localizers that did not decline every walk."""
        return [row for row in self._rows if row["served"]]

    def _cells(self) -> tuple[list[str], list[list[str]]]:
        names = [*SHOWN, *shown_besides(self._rows)]
        is_compared = any("value" in (row["behind"] or ()) for row in self._played)
        lines = [
            [row["env"], row["split"], shown_name(row["localizer"], row["division"]), _walks(row)]
            + [_cell(row["metrics"].get(name)) for name in names]
            + (behind_cells(row, _cell) if is_compared else [])
            for row in self._played
        ]
        return ["env", "split", "localizer", "walks", *names, *(BEHIND if is_compared else ())], lines

    def _notes(self) -> list[str]:
        """What to know when reading the table."""
        notes = [
            "mean over walks (seeds averaged first), pooled_ over all positions; percentiles by Hazen",
            *dict.fromkeys(f"{r['env']}: {describe_interval(r['units'], r['unit_kind'])}" for r in self._played),
        ]
        if any("value" in (row["behind"] or ()) for row in self._played):
            notes.append(f"behind_best_m: difference of {RANKING} on the same walks; p_holm: sign-flip test, Holm")
        absent = Counter(row["env"] for row in self._rows if not row["served"])
        notes += [f"{env}: {counted('localizer', count)} declined every walk" for env, count in absent.items()]
        medians = [name for name in shown_besides(self._rows) if METRICS[name].over_walks == "median"]
        if medians:
            notes.append(f"median over walks, never where half of them have none: {', '.join(medians)}")
        for row in self._played:
            who = f"{row['localizer']} on {row['env']}"
            if row["division"] == OFFLINE:
                notes.append(f"{who}: {describe_offline(row['revise_s'])}")
            if row["seeds"] > 1:
                notes.append(f"{who}: {row['seeds']} seeds")
            if row["failed"]:
                notes.append(f"{who}: {row['failed']} runs failed and are scored with what was answered before")
            if row["unsuitable"]:
                notes.append(f"{who}: {row['unsuitable']} runs declined and not scored")
        notes += dict.fromkeys(f"{row['env']}: {row['note']}" for row in self._rows if row["note"])
        machines = dict.fromkeys(machine_text(result.provenance.get("machine")) for result in self.results)
        return [*notes, *(f"time measured on {machine}" for machine in machines if machine)]


NUM_NAMES: Final = 3  # env, split, localizer


def _walks(row: Row) -> str:
    """Number of walks of a row, and how many of them the localizer did not decline."""
    return str(row["walks"]) if row["served"] == row["walks"] else f"{row['served']} of {row['walks']}"


def load_results(folder: Path | str) -> Results:
    """Reads a folder of stored results, or one result file.

    Where a folder holds results of several versions of a localizer, of its parameters or of an environment, those
    stored last are taken, and a warning says how many were left out.

    Raises:
        ResultError: There is none, or one is torn.
    """
    folder = Path(folder)
    paths = [folder] if folder.is_file() else sorted(folder.glob(f"*{store.SUFFIX}"))
    if not paths:
        raise ResultError(
            f"no results in {folder}; evaluate(..., out=folder) or `pdrbench run --out` stores them there"
        )
    stored = [(path.stat().st_mtime_ns, store.load(path)) for path in paths]
    newest: dict[tuple[str, str], tuple[int, str]] = {}
    for time_ns, result in stored:
        place = (result.env, result.localizer)
        newest[place] = max(newest.get(place, (0, "")), (time_ns, _variant(result)))
    kept = [result for _, result in stored if newest[result.env, result.localizer][1] == _variant(result)]
    if len(kept) < len(stored):
        left_out = len(stored) - len(kept)
        warnings.warn(f"{left_out} results in {folder} are of older versions and are left out", stacklevel=2)
    return Results(tuple(_in_order(kept)))


def _in_order(results: Sequence[Result]) -> list[Result]:
    """Walks in the order of their split where the environment is known, else by name."""

    def place(result: Result) -> tuple[Any, ...]:
        walks = make_task(result.task).walks.get(result.split, ())
        rank = walks.index(result.walk) if result.walk in walks else len(walks)
        return result.env, result.split, rank, result.walk, result.localizer, result.seed

    return sorted(results, key=place)


def _variant(result: Result) -> str:
    return json.dumps({name: result.provenance.get(name) for name in VARIANT}, sort_keys=True)


def _side_by_side(walks: pd.DataFrame, metric: str) -> tuple[dict[str, FloatArray], list[str]]:
    """Per localizer (W,) values on all walks in the same order, over the seeds that all have; and the units.

    A localizer with one seed does not draw: its walks count as those of every seed.
    """
    wide = walks.pivot(index=["walk", "seed"], columns="localizer", values=metric)
    tried = walks.assign(tried=True).pivot(index=["walk", "seed"], columns="localizer", values="tried")
    num_seeds = walks.groupby("localizer")["seed"].nunique()
    for name in num_seeds.index[num_seeds == 1]:
        wide[name], tried[name] = (of.groupby(level="walk")[name].transform("first") for of in (wide, tried))
    by_walk = wide[tried.notna().all(axis=1)].groupby(level="walk", sort=True).mean()
    unit = walks.drop_duplicates("walk").set_index("walk")["unit"]
    values = {name: by_walk[name].to_numpy(np.float64) for name in dict.fromkeys(walks["localizer"])}
    return values, [str(unit[walk]) for walk in by_walk.index]


def _cell(entry: dict[str, Any] | None) -> str:
    if entry is None or entry["value"] is None:
        return NOTHING
    if entry["low"] is None or entry["high"] is None:
        return decimals(entry["value"])
    return f"{decimals(entry['value'])} [{decimals(entry['low'])}, {decimals(entry['high'])}]"


def _latex(text: str) -> str:
    return re.sub(r"([&%$#_{}])", r"\\\1", text).replace("–", "--")


def _written(text: str, path: Path | str | None) -> str:
    if path is not None:
        Path(path).write_text(text, encoding="utf-8", newline="\n")
    return text
