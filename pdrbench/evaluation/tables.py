"""Many results as tables: scores by walk, means over walks with intervals, paired comparisons; read from a folder."""

from __future__ import annotations

import copy
import functools
import html
import json
import math
import re
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pdrbench.errors import ResultError, plain_cell, plain_text, unknown_name
from pdrbench.evaluation import store
from pdrbench.evaluation.rows import finite, ranking_of, rows_of, side_by_side
from pdrbench.evaluation.scoring import Scored, score_all
from pdrbench.evaluation.wording import brief, footnotes, in_a_line, score_tables
from pdrbench.metrics import METRICS
from pdrbench.metrics.ranking import Ranking
from pdrbench.registry import EXCHANGES_GROUP, canonical_localizer, find_entry, make_task
from pdrbench.result import Result, by_division

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

LATEX_HEADS: Final = {"ratio_to_best": "ratio", "p75_geometric_m": "p75 (m)", "mean_m": "mean (m)"}
IDENTITY: Final = ("env", "localizer", "division", "split", "walk", "seed")


# What has to agree for results of one localizer on one environment to belong in one row.
VARIANT: Final = (*("files_sha256", "environment", "localizer_sha256", "parameters", "budget", "versions", "nonce"),)


@dataclass(frozen=True)
class Results:
    """What came of a sweep; scores are computed when they are first asked for.

    Attributes:
        results: In the order of environments, walks, localizers, seeds; those that count offline follow, see
            `result.by_division`.
        jobs: Processes that compute the scores.
        secret: Behind the walks, where they are held out.
        kept: Folder where scores are kept, as `score_all` takes it.
        compared_with: Localizer that every other is compared with, see `against`.
    """

    results: tuple[Result, ...]
    jobs: int = 1
    secret: str | None = field(default=None, repr=False)
    kept: Path | None = None
    compared_with: str | None = None

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[Result]:
        return iter(self.results)

    def _repr_html_(self) -> str:
        """The tables, at the end of a cell of a notebook."""
        import pandas as pd

        found = score_tables(self._rows, in_a_line)
        tables = [(title, pd.DataFrame(lines, columns=header)) for title, header, lines in found]
        with pd.option_context("display.max_colwidth", None):
            parts = [
                f"<h4>{html.escape(plain_text(title))}</h4>{table.to_html(index=False)}" for title, table in tables
            ]
        return "".join([*parts, *(f"<p>{html.escape(plain_text(note))}</p>" for note in self.notes())])

    def __repr__(self) -> str:
        counts = Counter(result.status for result in self.results)
        return f"Results({', '.join(f'{count} {status}' for status, count in counts.items()) or 'none'})"

    def __post_init__(self) -> None:
        object.__setattr__(self, "results", tuple(by_division(self.results)))

    @functools.cached_property
    def scored(self) -> tuple[Scored, ...]:
        """Scores of each result."""
        return tuple(score_all(self.results, self.jobs, self.secret, self.kept))

    def walks(self) -> pd.DataFrame:
        """One row for each environment, localizer, division, walk and seed, with every metric, NaN without."""
        import pandas as pd

        rows = [
            {name: getattr(result, name) for name in IDENTITY}
            | {"status": result.status, "building": scored.building, "unit": scored.unit}
            | {name: scored.scores.get(name, math.nan) for name in METRICS}
            for result, scored in zip(self.results, self.scored, strict=True)
        ]
        return pd.DataFrame(rows, columns=[*IDENTITY, "status", "building", "unit", *METRICS])

    def rows(self) -> list[dict[str, Any]]:
        """The summary as `compare --json` prints it: an entry for each environment, split, localizer and division.

        A localizer that revises its estimates when a walk is over has two: "online" by the answers as they were given,
        "offline" by those revised; `revise_s` is the mean wall time which that took. `of` walks were tried, `walks` of
        them played to their end; `units` and `unit_kind` say of how many of what.

        `metrics` has by name `value`, `unit`, `low`, `high` and `n`. `value` is the mean over walks of the mean over
        seeds, or the median of the median where the metric says so; `low` and `high` bound its 95 % interval by the
        spread of whole units (`metrics.statistics.mean_interval`), or of walks where there are fewer than four units,
        None below four walks; `n` is the number of walks with the metric. Names with `pooled_` are over all positions
        of all walks and seeds together. What does not apply is None; so is a time that is infinite, which `n` shows: a
        value that is None for more than 0 walks.

        `p75_geometric_m` is the geometric mean over walks of `p75_level_penalised_m`, `ratio_to_best` its ratio to the
        best localizer that played every walk, `p_holm` the p-value of their difference, corrected within environment,
        split and division. `rank` is [low, high]: the places that these tests leave, None where no walk was played to
        its end; walks that are missing are imputed, see `metrics.ranking.rank`. `smallest_ratio` between neighbours
        can be told by so many walks.

        `strata` holds the same of parts of the results: walks of one of the task's groups (`by` "group"), places by
        their distance to the nearest scan of a recorded survey ("radio"); `declined` counts runs that were declined.
        """
        return [finite(row) for row in self._rows]

    @functools.cached_property
    def _rows(self) -> list[dict[str, Any]]:
        return rows_of(list(zip(self.results, self.scored, strict=True)), self.rankings, self.compared_with)

    def to_frame(self) -> pd.DataFrame:
        """The summary, a line for each environment, split, localizer, division and metric; infinite: never happened."""
        import pandas as pd

        columns = ["env", "localizer", "division", "split", "walks", "stratum", "metric"]
        columns += ["value", "unit", "low", "high", "n"]
        lines = [
            {name: row[name] for name in ("env", "localizer", "division", "split", "walks")}
            | {"stratum": name, "metric": metric, **entry}
            for row in self._rows
            for name, part in (("", row), *((of["name"], of) for of in row["strata"]))
            for metric, entry in part["metrics"].items()
        ]
        frame = pd.DataFrame(lines, columns=columns)
        return frame.astype(dict.fromkeys(("value", "low", "high"), np.float64))

    @functools.cached_property
    def rankings(self) -> dict[tuple[str, str, str], Ranking]:
        """Who is ahead and how sure that is, every pair included, by environment, split and division."""
        found = side_by_side(list(zip(self.results, self.scored, strict=True)))
        rankings = {place: ranking_of(played) for place, played in found.items()}
        return {place: ranking for place, ranking in rankings.items() if ranking is not None}

    def against(self, localizer: str) -> Results:
        """The same results, with `ratio_against` and `p_against` in rows and tables: each localizer against this one.

        P-values are corrected for these comparisons alone, within environment, split and division.
        """
        name = canonical_localizer(localizer)
        if name not in (known := dict.fromkeys(result.localizer for result in self.results)):
            raise unknown_name("localizer in these results", name, known)
        found = copy.copy(self)
        object.__setattr__(found, "compared_with", name)
        found.__dict__.pop("_rows", None)
        return found

    def table(self, columns: Sequence[str] | None = None) -> str:
        """Plain text: one line for each localizer and division, and what to know when reading it.

        Args:
            columns: "rank" and names of metrics, as in `rows`; None: `COLUMNS`.
        """
        text = []
        for title, header, lines in score_tables(self._rows, in_a_line, columns):
            widths = [max(len(line[column]) for line in [header, *lines]) for column in range(len(header))]
            rule = ["-" * width for width in widths]
            padded = [[cell.ljust(w) for cell, w in zip(line, widths, strict=True)] for line in (header, rule, *lines)]
            text += [title, *("  ".join(line).rstrip() for line in padded), ""]
        return "\n".join([*text, *self.notes(columns)])

    def to_markdown(self, columns: Sequence[str] | None = None) -> str:
        """The tables in Markdown; `columns` as in `table`."""
        text = []
        for title, header, lines in score_tables(self._rows, in_a_line, columns):
            table = [header, [":--"] + ["--:"] * (len(header) - 1), *lines]
            text += [f"{title}:", ""]
            text += ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in table] + [""]
        return "\n".join([*text, *(f"* {note}" for note in self.notes(columns)), ""])

    def to_latex(self, columns: Sequence[str] | None = None) -> str:
        """The tables in LaTeX, for the package booktabs; `columns` as in `table`.

        One localizer a line with values alone fits a column of 85 mm in \\small; the interval stands with the ratio.
        """
        text = []
        for title, header, lines in score_tables(self._rows, brief, columns, has_strata=False):
            text += [
                f"% {title}",
                rf"\begin{{tabular}}{{l{'r' * (len(header) - 1)}}}",
                r"\toprule",
                " & ".join(latex_text(LATEX_HEADS.get(name, name)) for name in header) + r" \\",
                r"\midrule",
                *(" & ".join(latex_text(cell) for cell in line) + r" \\" for line in lines),
                r"\bottomrule",
                r"\end{tabular}",
            ]
        return "\n".join([*text, *(f"% {note}" for note in self.notes(columns)), ""])

    def to_csv(self, path: Path | str | None = None) -> str:
        """`to_frame` as CSV; also written to `path` where one is given."""
        frame = self.to_frame()
        texts = {
            str(name): frame[name].map(plain_cell) for name in frame if isinstance(frame[name].iloc[:1].max(), str)
        }
        return _written(str(frame.assign(**texts).to_csv(index=False)), path)

    def to_json(self, path: Path | str | None = None) -> str:
        """`{"rows": rows()}` as JSON; also written to `path` where one is given."""
        return _written(json.dumps({"rows": self.rows()}, indent=2, allow_nan=False) + "\n", path)

    def plot_cdf(self) -> Figure:
        """The distribution of the errors of each localizer, a panel for each environment; `savefig` writes it."""
        figure: Figure = self._export("plot_cdf")
        return figure

    def plot_walk(self, index: int = 0) -> Figure:
        """One walk on its plan with every localizer, of several seeds the first; walks count from 0 as they came."""
        figure: Figure = self._export("plot_walk", index)
        return figure

    def methods(self, columns: Sequence[str] | None = None) -> str:
        """A paragraph on methods in LaTeX, of what was run, and BibTeX of what it cites; `columns` as in `table`."""
        return str(self._export("methods", columns))

    def _export(self, name: str, *arguments: object) -> Any:
        return find_entry(EXCHANGES_GROUP, "exchange", name).load()(self, *arguments)

    def notes(self, columns: Sequence[str] | None = None) -> list[str]:
        """What to know when reading the tables, a line each."""
        return footnotes(self._rows, self.results, columns)


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


def latex_text(text: str) -> str:
    """Text as LaTeX shows it."""
    return re.sub(r"([&%$#_{}])", r"\\\1", text).replace("–", "--")


def _written(text: str, path: Path | str | None) -> str:
    if path is not None:
        Path(path).write_text(text, encoding="utf-8", newline="\n")
    return text
