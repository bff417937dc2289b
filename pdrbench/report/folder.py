"""The folder that a comparison leaves behind: tables, distributions, trajectories."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from pdrbench.errors import PdrbenchError, unknown_name
from pdrbench.evaluation.scoring import answers_sha256, code_sha256
from pdrbench.geometry import FloatArray
from pdrbench.metrics.statistics import MIN_UNITS
from pdrbench.picture import styles_of
from pdrbench.registry import make_task
from pdrbench.report.cdf import LocalizerErrors, Styles, draw_cdf
from pdrbench.report.walks import draw_walk
from pdrbench.result import UNSUITABLE, Result, shown_name
from pdrbench.task import Task

if TYPE_CHECKING:
    from pdrbench.evaluation import Results
    from pdrbench.evaluation.scoring import Scored

DPI: Final = 160
# Walks that get a picture, as quantiles of the error: the median, near the worst, near the best, the worst.
QUANTILES: Final = (0.5, 0.9, 0.1, 1.0)
# The same results give the same files; by the formats that can be asked for.
UNDATED: Final = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
CAPTIONS: Final = "captions.md"
STAMP: Final = ".report.json"  # what the files of a report were made of


@dataclass(frozen=True, slots=True)
class FigureOptions:
    """How the figures of a report look.

    Attributes:
        size_in: Width and height of distributions in inches; None: as fits. Floor plans keep their own.
        formats: Of "png", "pdf" and "svg"; walks on the floor plan are drawn in the first one only.
        labels: What to call a localizer, by id.
        title: In place of the environment and the split.
        is_log: Whether errors have a logarithmic axis.
        has_captions: Whether titles stand in `captions.md`, as papers want them, and not in the figures.
    """

    size_in: tuple[float, float] | None = None
    formats: tuple[str, ...] = ("png", "pdf")
    labels: Mapping[str, str] = field(default_factory=dict)
    title: str | None = None
    is_log: bool = False
    has_captions: bool = False

    def __post_init__(self) -> None:
        for kind in self.formats:
            if kind not in UNDATED:
                raise unknown_name("format of figures", kind, UNDATED)


@dataclass(frozen=True, slots=True)
class SplitResults:
    """The results of one environment and split.

    Attributes:
        task: The environment.
        split: "train", "val" or "test".
        results: What was scored, under the names that are shown; localizers that declined are not among them.
        scored: Scores and errors of each of them.
    """

    task: Task
    split: str
    results: tuple[Result, ...]
    scored: tuple[Scored, ...]

    @property
    def name(self) -> str:
        """For file names: the environment, and the split where it is not "test"."""
        return self.task.id if self.split == "test" else f"{self.task.id}-{self.split}"

    @property
    def localizers(self) -> tuple[str, ...]:
        """In the order in which they were evaluated."""
        return tuple(dict.fromkeys(result.localizer for result in self.results))


def write_report(
    results: Results, folder: Path, options: FigureOptions | None = None, columns: Sequence[str] | None = None
) -> list[Path]:
    """Writes tables and plots.

    Tables: `table.md`, `table.tex`, `table.csv`, `rows.json`. For each environment: `<env>-cdf` (distribution of the
    errors of every localizer) as PNG and PDF, and `<env>-walk-<n>.png` (trajectories on the floor plan, for at most
    four walks, the one of median error first). The reference is looked up, as `score` does.

    Args:
        results: From `evaluate` or `load_results`.
        folder: Made where it is missing; files of the same name are replaced.
        options: How figures look.
        columns: Of `table.md` and `table.tex`, as `Results.table` takes them.

    Returns:
        Every file written, or left as it is, since the same results gave it before.
    """
    folder.mkdir(parents=True, exist_ok=True)
    options = options or FigureOptions()
    origin = "" if results.kept is None else _origin(results, options, columns)
    stamp = folder / STAMP
    with contextlib.suppress(OSError, ValueError, TypeError, AttributeError):
        before = json.loads(stamp.read_bytes())
        if before["origin"] == origin and before["files"] == _sha256(folder, before["files"]):
            return [folder / name for name in before["files"]]
    named = as_shown(results.results, options.labels)
    styles = styles_of(result.localizer for result in named if result.status != UNSUITABLE)
    written = _write_tables(results, folder, columns)
    captions: dict[str, str] = {}
    for part in split_parts(named, results.scored):
        for name, figure in _figures(part, styles, options):
            captions[name] = "; ".join(figure.get_suptitle().split("\n"))
            written += _save(figure, folder / _plain(name), options, is_plan="-walk-" in name)
    if options.has_captions:
        written.append(folder / CAPTIONS)
        written[-1].write_text(
            "".join(f"{_plain(name)}: {text}.\n" for name, text in captions.items()), encoding="utf-8", newline="\n"
        )
    if origin:
        files = _sha256(folder, [path.name for path in written])
        stamp.write_text(json.dumps({"origin": origin, "files": files}), encoding="utf-8")
    return written


def _origin(results: Results, options: FigureOptions, columns: Sequence[str] | None) -> str:
    """Digest of everything that a report follows from."""
    walks = {(result.task, result.walk) for result in results.results}
    code = {env: code_sha256(env) for env, _ in walks}
    facts: list[object] = [matplotlib.__version__, dataclasses.asdict(options), columns, results.compared_with]
    facts += [(code[env], sorted(make_task(env).walk_identity(walk).items())) for env, walk in sorted(walks)]
    facts += [(r.localizer, r.seed, r.walk, r.division, answers_sha256(r)) for r in results.results]
    return hashlib.sha256(repr(facts).encode()).hexdigest()


def _sha256(folder: Path, names: Iterable[str]) -> dict[str, str]:
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in names}


def _write_tables(results: Results, folder: Path, columns: Sequence[str] | None) -> list[Path]:
    tables = {
        "table.md": results.to_markdown(columns),
        "table.tex": results.to_latex(columns),
        "table.csv": results.to_csv(),
        "rows.json": results.to_json(),
    }
    for name, text in tables.items():
        (folder / name).write_text(text if text.endswith("\n") else text + "\n", encoding="utf-8", newline="\n")
    return [folder / name for name in tables]


def as_shown(results: Sequence[Result], labels: Mapping[str, str]) -> list[Result]:
    """The same results under their labels, with a mark at those that count offline."""
    known = dict.fromkeys(result.localizer for result in results)
    for name in labels:
        if name not in known:
            raise unknown_name("localizer in these results", name, known)
    names = {name: labels.get(name) or name for name in known}
    if len(set(names.values())) < len(names):
        raise PdrbenchError("two localizers have the same label; give each its own")
    return [dataclasses.replace(r, localizer=shown_name(names[r.localizer], r.division)) for r in results]


def split_parts(results: Sequence[Result], scores: Sequence[Scored]) -> Iterator[SplitResults]:
    """Results by environment and split, in the order in which they came."""
    groups: dict[tuple[str, str], list[tuple[Result, Scored]]] = {}
    for pair in zip(results, scores, strict=True):
        groups.setdefault((pair[0].env, pair[0].split), []).append(pair)
    for (_, split), group in groups.items():
        played = [pair for pair in group if pair[0].status != UNSUITABLE]
        if played:
            yield SplitResults(
                make_task(group[0][0].task), split, tuple(r for r, _ in played), tuple(s for _, s in played)
            )


def _figures(part: SplitResults, styles: Styles, options: FigureOptions) -> Iterator[tuple[str, Figure]]:
    """Every figure of an environment and split, after its name."""
    errors = [errors_of(part, localizer) for localizer in part.localizers]
    title = _title(part) if options.title is None else options.title
    yield f"{part.name}-cdf", _cdf(part, errors, styles, title, is_log=options.is_log)
    for number, (walk, why) in enumerate(_walks_to_draw(errors).items(), start=1):
        chosen = {r.localizer: r for r in reversed(part.results) if r.walk == walk}
        chosen = {localizer: chosen[localizer] for localizer in part.localizers if localizer in chosen}
        figure = draw_walk(part.task.load(walk), chosen, styles, f"{title}\nwalk {walk}: {why}")
        yield f"{part.name}-walk-{number}", figure


def errors_of(part: SplitResults, localizer: str) -> LocalizerErrors:
    """Errors of one localizer at the surveyed positions, as they are scored; the seeds of a walk together."""
    by_walk: dict[str, list[FloatArray]] = {}
    unit: dict[str, str] = {}
    for result, scored in zip(part.results, part.scored, strict=True):
        if result.localizer == localizer:
            by_walk.setdefault(result.walk, []).append(scored.errors_m)
            unit[result.walk] = scored.unit
    return LocalizerErrors(localizer, {walk: np.concatenate(parts) for walk, parts in by_walk.items()}, unit)


def _cdf(part: SplitResults, errors: Sequence[LocalizerErrors], styles: Styles, title: str, *, is_log: bool) -> Figure:
    figure = Figure(figsize=(7.0, 4.6), layout="constrained")
    ax = figure.add_subplot()
    draw_cdf(ax, errors, styles, is_log=is_log)
    walks = max((len(entry.by_walk) for entry in errors), default=0)
    units = max((len(set(entry.unit.values())) for entry in errors), default=0)
    kind = part.task.unit_kind
    band = f"band: 95 % by {kind}" if units >= MIN_UNITS else f"no band: unit is the {kind}, fewer than {MIN_UNITS}"
    figure.suptitle(f"{title}\n{walks} walks; {band}", fontsize=9)
    return figure


def _walks_to_draw(errors: Sequence[LocalizerErrors]) -> dict[str, str]:
    """The reason by walk. Walks are ordered by their mean rank over localizers, so that no single localizer decides."""
    ranks: dict[str, list[float]] = {}
    for entry in errors:
        means_m = entry.means_m
        values_m = np.array([*means_m.values()])
        ends = [np.searchsorted(np.sort(values_m), values_m, side) for side in ("left", "right")]
        for walk, rank in zip(means_m, (ends[0] + ends[1] + 1) / 2, strict=True):  # ties share their mean rank
            ranks.setdefault(walk, []).append(float(rank) / len(means_m))
    order = sorted(ranks, key=lambda walk: (float(np.mean(ranks[walk])), walk))
    chosen: dict[str, str] = {}
    for quantile in QUANTILES if order else ():
        place = round(quantile * (len(order) - 1))
        chosen.setdefault(order[place], f"number {place + 1} of {len(order)} by error, smallest first")
    return chosen


def _title(part: SplitResults) -> str:
    note = f"\n{part.task.note}" if part.task.note else ""
    return f"{part.task.id}, {part.split} split{note}"


def _save(figure: Figure, stem: Path, options: FigureOptions, *, is_plan: bool) -> list[Path]:
    if options.has_captions:
        figure.suptitle("")
    if options.size_in is not None and not is_plan:
        figure.set_size_inches(options.size_in)
    kinds = options.formats[:1] if is_plan else options.formats
    paths = [stem.with_name(f"{stem.name}.{kind}") for kind in kinds]
    with matplotlib.rc_context({"svg.hashsalt": stem.name}):
        for path in paths:
            figure.savefig(path, dpi=DPI, metadata=UNDATED[path.suffix[1:]])
    return paths


def _plain(name: str) -> str:
    """A name that every file system takes."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", name)
