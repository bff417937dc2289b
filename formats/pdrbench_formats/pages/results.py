"""Results for a notebook or a paper: figures, and a paragraph on methods in LaTeX with what it cites."""

from __future__ import annotations

import io
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from pdrbench.datasets import dataset
from pdrbench.errors import PdrbenchError
from pdrbench.evaluation import Results
from pdrbench.evaluation.tables import latex_text
from pdrbench.evaluation.wording import COLUMNS, counted, describe_interval, machine_text
from pdrbench.metrics import METRICS
from pdrbench.picture import styles_of
from pdrbench.registry import CARDS_FILE, localizers, make_task
from pdrbench.report.cdf import draw_cdf
from pdrbench.report.folder import as_shown, errors_of, split_parts
from pdrbench.report.pages import render
from pdrbench.report.walks import draw_walk
from pdrbench.result import UNSUITABLE
from pdrbench.settings import split_name


def plot_cdf(results: Results) -> Figure:
    """See `Results.plot_cdf`."""
    parts = list(split_parts(as_shown(results.results, {}), results.scored))
    figure = ShownFigure(figsize=(7.0 * max(len(parts), 1), 4.6), layout="constrained")
    styles = styles_of(name for part in parts for name in part.localizers)
    for place, part in enumerate(parts):
        ax = figure.add_subplot(1, len(parts), place + 1)
        draw_cdf(ax, [errors_of(part, localizer) for localizer in part.localizers], styles)
        ax.set_title(part.name, fontsize=9)
    return figure


def plot_walk(results: Results, index: int) -> Figure:
    """See `Results.plot_walk`."""
    walks = list(dict.fromkeys((result.task, result.walk) for result in results))
    if not -len(walks) <= index < len(walks):
        raise PdrbenchError(f"there are {len(walks)} walks, counted from 0; got {index}")
    env, walk = walks[index]
    played = [r for r in as_shown(results.results, {}) if (r.task, r.walk) == (env, walk) and r.status != UNSUITABLE]
    first = {r.localizer: r for r in reversed(played)}
    first = {r.localizer: first[r.localizer] for r in played}
    task = make_task(env, results.secret)
    title = f"{task.id}, walk {walk}"
    return draw_walk(task.load(walk), first, styles_of(first), title, kind=ShownFigure)


class ShownFigure(Figure):
    """A figure that shows itself at the end of a cell of a notebook, whether or not pyplot was ever imported."""

    def _repr_png_(self) -> bytes:
        written = io.BytesIO()
        self.savefig(written, format="png", dpi=self.dpi)
        return written.getvalue()


def methods_text(results: Results, columns: Sequence[str] | None) -> str:
    """See `Results.methods`; the words are in `templates/methods.tex`."""
    rows: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in results.rows():
        rows.setdefault((row["env"], row["split"]), []).extend([row] if row["metrics"] else [])
    tasks = {result.env: make_task(result.task, results.secret) for result in results}
    names = {row["localizer"]: split_name(row["localizer"])[0] for of in rows.values() for row in of}
    cited = {plain: paper for plain in names.values() if (paper := _paper(plain))}
    cited |= {task.dataset: dataset(task.dataset).citation for task in tasks.values() if task.dataset is not None}
    sources = [result.provenance for result in results]
    return render(
        "methods.tex",
        package="pdrbench_formats.pages",
        plays=[(tasks[env], split, of) for (env, split), of in rows.items() if of],
        names=names,
        cited=cited,
        metrics=[METRICS[name] for name in columns or COLUMNS if name in METRICS],
        against=results.compared_with,
        versions=sorted({str(of): of for source in sources if (of := source.get("versions"))}.items()),
        machines=sorted({machine_text(source.get("machine")) for source in sources} - {""}),
        nonces=sorted({str(source["nonce"]) for source in sources if source.get("nonce")}),
        latex=latex_text,
        counted=counted,
        interval=describe_interval,
    )


def _paper(localizer: str) -> str:
    """What the card of a registered localizer says to cite; empty where it has none."""
    entry = localizers().get(localizer)
    file = None if entry is None or entry.folder is None else entry.folder / CARDS_FILE
    known: Mapping[str, Any] = tomllib.loads(file.read_text(encoding="utf-8")) if file and file.is_file() else {}
    return str(known.get(localizer, {}).get("paper", ""))
