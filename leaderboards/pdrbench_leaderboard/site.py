"""The leaderboards as a static site: pages, and the numbers they draw in files of their own.

Nothing is fetched from anywhere, and pages open from a file. Cards are untrusted text: templates escape everything,
scripts write text and never markup, and a content security policy lets no other script run.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.resources
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pdrbench import __version__
from pdrbench.errors import ResultError
from pdrbench.evaluation.number_text import page_decimals
from pdrbench.evaluation.origin import package_sha256
from pdrbench.evaluation.scoring import answers_sha256
from pdrbench.evaluation.wording import machine_text
from pdrbench.metrics import METRICS, POOLED
from pdrbench.result import OFFLINE, ONLINE
from pdrbench_leaderboard import downloads, overview, page_data, table
from pdrbench_leaderboard.plausibility import Finding, flags
from pdrbench_leaderboard.ranking import SIGNIFICANT, Board, Standing
from pdrbench_leaderboard.suites import find_suite

if TYPE_CHECKING:
    from jinja2 import Environment

SCRIPTS: Final = (
    "index.js",
    "data.js",
    "draw.js",
    "charts.js",
    "plan.js",
    "replay.js",
    "board.js",
    "entry.js",
    "compare.js",
)
FILES: Final = ("style.css", "theme.js", "index.js", *SCRIPTS)
MADE: Final = ".made.json"  # what costly files of a site were made of
MAX_TICKS: Final = 3  # of the axis in the head of a narrow column


def write_site(boards: Sequence[Board], folder: Path, jobs: int = 1) -> list[Path]:
    """Writes the whole site; files of the same name are replaced, others left.

    Args:
        boards: In the order of the index.
        folder: Made where it is missing.
        jobs: Processes that draw floor plans.

    Returns:
        Every file written.
    """
    write = _Writer(folder)
    pages = _templates()
    by_name = overview.places(boards)
    entry_slugs = {board.task.id: overview.slugs([standing.name for standing in board.standings]) for board in boards}
    common: dict[str, Any] = {
        "version": __version__,
        "boards": [_summary(board) for board in boards],
        "slugs": overview.slugs(list(by_name)),
        "suites": sorted({standing.entry.suite for board in boards for standing in board.standings}),
    }
    common["sources"] = _write_sources(by_name, common["slugs"], write)
    write.text("index.html", pages.get_template("index.html").render(common, root=""))
    for suite in common["suites"]:
        facts = overview.suite_facts(suite, boards, entry_slugs)
        write.text(f"suites/{suite}.html", pages.get_template("suite.html").render(common, root="../", suite=facts))
    for name, of in by_name.items():
        facts = overview.localizer_facts(name, of, entry_slugs)
        page = pages.get_template("localizer.html").render(common, root="../", localizer=facts)
        write.text(f"localizers/{common['slugs'][name]}.html", page)
    files = importlib.resources.files("pdrbench_leaderboard") / "page"
    for name in FILES:
        write.text(f"page/{name}", (files / name).read_text(encoding="utf-8"))
    for board in boards:
        _write_board(board, entry_slugs[board.task.id], pages, common, write, jobs)
    write.close()
    return write.written


def _write_sources(
    by_name: Mapping[str, Sequence[overview.Place]], slugs: Mapping[str, str], write: _Writer
) -> list[str]:
    """Names of the localizers whose source can be downloaded."""
    found = []
    for name, of in by_name.items():
        source = overview.source_archive(of[0].standing.entry.manifest.spec)
        if source is not None:
            write.content(f"localizers/{slugs[name]}.source.zip", source)
            found.append(name)
    return found


class _Writer:
    """Writes files below a folder and remembers them, and in `MADE` what the costly ones were made of."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.written: list[Path] = []
        self._made: dict[str, list[str]] = {}
        self._code = [__version__, package_sha256("pdrbench_leaderboard")]
        self._before: Mapping[str, Any] = {}
        with contextlib.suppress(OSError, ValueError):
            self._before = dict(json.loads((folder / MADE).read_bytes()))

    def costly(self, name: str, origin: object, make: Callable[[], bytes]) -> None:
        """A file that is left as it is where the same `origin` gave it before."""
        key = hashlib.sha256(repr((self._code, origin)).encode()).hexdigest()
        path = self.folder / name
        is_same = path.is_file() and self._before.get(name) == [key, _file_sha256(path)]
        if is_same:
            self.written.append(path)
        else:
            self.content(name, make())
        self._made[name] = self._before[name] if is_same else [key, _file_sha256(path)]

    def close(self) -> None:
        """Remembers what was made of what, for the next time."""
        self.text(MADE, json.dumps(self._made))

    def text(self, name: str, text: str) -> None:
        self.content(name, text.encode())

    def content(self, name: str, content: bytes) -> None:
        path = self.folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        except OSError as error:
            raise ResultError(f"cannot write {path}: {error.strerror}; choose another place") from error
        self.written.append(path)

    def data(self, name: str, content: object) -> None:
        """Numbers that a page fetches as a script, which also works from a file."""
        self.content(name, _script(name, content))


def _script(name: str, content: object) -> bytes:
    key = json.dumps(name.removesuffix(".js"))
    return f"pdrbench.receive({key}, {json.dumps(content, allow_nan=False, separators=(',', ':'))});\n".encode()


def _file_sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _templates() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("pdrbench_leaderboard", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"interval": table.with_interval, "digits": page_decimals}
    environment.filters |= {
        "breaks": _with_breaks,
        "web": web_address,
        "parts": lambda text: text.split("`"),
    }  # odd ones are names
    return environment


def _with_breaks(name: str) -> Any:
    """A name that may be broken where a word begins: before `Site` in `BuildingSite`, after each underscore."""
    from markupsafe import Markup, escape

    parts = re.split(r"(?<=[a-z0-9])(?=[A-Z])|(?<=_)", name)
    return Markup("<wbr>").join(escape(part) for part in parts)


def web_address(url: str) -> str:
    """An address that may become a link: http or https, nothing else; else empty.

    >>> web_address("https://example.org/a"), web_address("javascript:alert(1)"), web_address(" http://x")
    ('https://example.org/a', '', '')
    """
    return url if re.fullmatch(r"https?://[^\s<>\"'\\]+", url) else ""


def _write_board(
    board: Board,
    slugs: Mapping[str, str],
    pages: Environment,
    common: Mapping[str, Any],
    write: _Writer,
    jobs: int,
) -> None:
    env = board.task.id
    ends = _ends(board)
    rows = [_shown(board, standing, slugs[standing.name], ends) for standing in board.standings]
    here = {**common, "board": downloads.board_facts(board), "rows": rows, "notes": [*table.notes(board)]}
    here["axis"] = _axis(ends)
    here["strata"] = dict(zip(("head", "lines"), table.strata(board), strict=True))
    write.text(f"{env}/index.html", pages.get_template("board.html").render(here, root="../"))
    write.text(f"{env}/compare.html", pages.get_template("compare.html").render(here, root="../"))
    write.text(f"{env}/board.json", json.dumps(downloads.board_json(board), indent=1, allow_nan=False) + "\n")
    write.text(f"{env}/board.csv", downloads.board_csv(board))
    of = [
        board.task.id,
        page_data.is_public(board),
        [(walk, board.task.walk_identity(walk)) for walk in board.walks],
    ]
    plans = f"{env}/plans.js"
    write.costly(plans, of, lambda: _script(plans, page_data.plans_data(board, jobs)))
    write.data(f"{env}/pairs.js", page_data.pairs_data(board))
    write.data(
        f"{env}/entries.js", [{"slug": slugs[s.name], "name": s.name, "label": s.label} for s in board.standings]
    )
    for standing in board.standings:
        _write_entry(board, standing, slugs, pages, here, write)


def _write_entry(
    board: Board,
    standing: Standing,
    slugs: Mapping[str, str],
    pages: Environment,
    here: Mapping[str, Any],
    write: _Writer,
) -> None:
    place = f"{board.task.id}/entries/{slugs[standing.name]}"
    row = next(row for row in here["rows"] if row["name"] == standing.name)
    facts = _entry_facts(board, standing, slugs)
    write.text(f"{place}.html", pages.get_template("entry.html").render(here, root="../../", row=row, **facts))
    cdf, walks = page_data.cdf_data(standing), page_data.walks_data(board, standing)
    write.data(f"{place}.js", {"name": standing.name, "cdf": cdf, "walks": walks})
    of = [(result.walk, result.seed, answers_sha256(result)) for result in standing.entry.results]
    tracks = f"{place}.tracks.js"
    write.costly(tracks, of, lambda: _script(tracks, page_data.tracks_data(standing)))
    write.costly(f"{place}.csv.gz", of, lambda: downloads.estimates_csv(standing))


def _summary(board: Board) -> dict[str, Any]:
    firsts = [standing for standing in board.ranked if standing.rank == 1]
    best = {}
    for division in (ONLINE, OFFLINE):  # two may share the first rank
        of = [standing for standing in firsts if standing.row["division"] == division]
        best[division] = {
            "names": [standing.name for standing in of],
            "value": of[0].held_out if of else {},
        }
    return {
        **downloads.board_facts(board),
        "entries": len(board),
        "best": best,
        "search": " ".join(
            [board.task.id, board.task.summary, *(standing.name for standing in board.standings)]
        ).lower(),
    }


def _shown(board: Board, standing: Standing, slug: str, ends: tuple[float, float] | None) -> dict[str, Any]:
    """One row of the table."""
    card = board.card(standing)
    value = standing.held_out
    return {
        "name": standing.name,
        "slug": slug,
        "label": standing.label,
        "why_unranked": standing.why_unranked,
        "authors": ", ".join(card.authors),
        "tier": standing.entry.tier,
        "division": standing.row["division"],
        "sensors": card.sensors_used,
        "map": card.map_used,
        "survey": card.survey_used,
        "value": value,
        "public": standing.public,
        "gap": standing.gap,
        "gap_text": table.gap_text(standing),
        "bar": _bar(ends, value),
        "mean": standing.metric("mean_m"),
        "pooled": standing.metric("pooled_mean_m"),
        "p95": standing.metric("p95_m"),
        "level": standing.metric("level_hit_rate"),
        "ahead": table.labels(board, board.beaten_by(standing.name)),
        "search": " ".join([standing.name, *card.authors, card.paper, card.notes]).lower(),
    }


def _ends(board: Board) -> tuple[float, float] | None:
    """Smallest and largest value or bound of a board, for a log scale; None where all are one."""
    every = [standing.held_out for standing in board.standings]
    ends = [end for entry in every for end in (entry.get("value"), entry.get("low"), entry.get("high")) if end]
    ends = [end for end in ends if math.isfinite(end) and end > 0]
    return None if not ends or min(ends) == max(ends) else (min(ends), max(ends))


def _axis(ends: tuple[float, float] | None) -> list[dict[str, Any]]:
    """Round numbers of the log scale of intervals and their places in percent; at most three, the outer ones kept."""
    if ends is None:
        return []
    decades = range(math.floor(math.log10(ends[0])), math.ceil(math.log10(ends[1])) + 1)
    steps = [factor * 10.0**decade for decade in decades for factor in (1, 2, 5)]
    inside = [step for step in steps if ends[0] * (1 - 1e-9) <= step <= ends[1] * (1 + 1e-9)]
    if len(inside) > MAX_TICKS:
        inside = [inside[0], inside[len(inside) // 2], inside[-1]]
    least, most = math.log(ends[0]), math.log(ends[1])
    return [{"at": round(100 * (math.log(step) - least) / (most - least), 1), "text": f"{step:g}"} for step in inside]


def _bar(ends: tuple[float, float] | None, value: Mapping[str, Any]) -> dict[str, float] | None:
    """Where value and interval lie between the ends, in percent of a log scale; None where they have no place."""
    if ends is None or not value or value["value"] <= 0:
        return None
    least, most = math.log(ends[0]), math.log(ends[1])

    def place(end: float | None) -> float:
        at = value["value"] if end is None else max(end, ends[0])
        return round(100 * (math.log(at) - least) / (most - least), 1)

    return {"value": place(None), "low": place(value["low"]), "high": place(value["high"])}


def _entry_facts(board: Board, standing: Standing, slugs: Mapping[str, str]) -> dict[str, Any]:
    """What the page of an entry shows beside its row."""
    known, found = {**METRICS, **POOLED}, standing.entry.verification
    return {
        "card": downloads.card_facts(standing),
        "entry": {
            "suite": standing.entry.suite,
            "of": sum(other.row["division"] == standing.row["division"] for other in board.ranked),
            "runs": len(standing.entry.results),
            "failed": standing.row["failed"],
            "unsuitable": standing.row["unsuitable"],
            "seeds": standing.row["seeds"],
            "isolation": ", ".join(standing.entry.isolation_modes),
            "machine": machine_text(standing.entry.machine),
            "verification": found,
            "held_out_round": "" if found is None or found.held_out is None else found.held_out.round,
            "held_out_failures": table.held_out_failures(standing),
            "flags": [flag for flag in flags_of(standing) if not flag.passed],
        },
        "metrics": [
            {"name": name, "unit": metric.unit, "what": metric.what, "value": standing.metric(name)}
            for name, metric in known.items()
            if standing.metric(name)
        ],
        "against": _against(board, standing, slugs),
    }


def flags_of(standing: Standing) -> list[Finding]:
    """What a submission is looked at for; those that did not pass refuse nothing, and are shown."""
    entry = standing.entry
    return flags(entry, find_suite(entry.suite).environment(entry.env), standing.scored)


def _against(board: Board, standing: Standing, slugs: Mapping[str, str]) -> list[dict[str, Any]]:
    """Every other entry that it was tested against, in the order of the board."""
    found = []
    for other in board.tested:
        pair = board.pair(standing.name, other.name)
        if pair is None:
            continue
        is_first = pair.first == standing.name
        found.append(
            {
                "name": other.name,
                "slug": slugs[other.name],
                "label": other.label,
                "effect": table.effect_of(pair, 1.0 if is_first else -1.0),
                "p": pair.p,
                "p_holm": pair.p_holm,
                "wins": pair.improvement if is_first else 1 - pair.improvement,
                "significant": pair.p_holm < SIGNIFICANT,
            }
        )
    return found
