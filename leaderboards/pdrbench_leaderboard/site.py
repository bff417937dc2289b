"""The boards as a static site: an index and a page for each board.

Nothing is fetched from anywhere, and pages open from a file. Cards are untrusted text: templates escape everything,
and a content security policy lets no other script run.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.resources
import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from markupsafe import Markup, escape

from pdrbench import __version__
from pdrbench.errors import DatasetError, plain_value
from pdrbench.evaluation import answers
from pdrbench.evaluation.origin import package_sha256
from pdrbench.evaluation.store import make_folder, remember, remembered, result_key, write_whole
from pdrbench.sensors import SENSORS
from pdrbench_leaderboard import pictures, table
from pdrbench_leaderboard.boards import Board
from pdrbench_leaderboard.checking import separability
from pdrbench_leaderboard.draw import make_truth, opaque_names
from pdrbench_leaderboard.record import read_answers
from pdrbench_leaderboard.standings import Row, Table

if TYPE_CHECKING:
    from jinja2 import Environment

FILES: Final = ("style.css", "theme.js", "filter.js", "replay.js")
FIRST: Final = 5  # entries of a board on the index
REPLAYS: Final = 3  # walks on the page of a board


def write_site(tables: Mapping[Board, Sequence[Table]], folder: Path) -> list[Path]:
    """Writes the whole site; files of the same name are replaced, others left.

    Args:
        tables: Both divisions of each board, in the order of the index.
        folder: Made where it is missing.

    Returns:
        Every file written.
    """
    pages, written = _templates(), []
    shown = {board.name: replays(of[0]) if of else [] for board, of in tables.items()}
    cards = [_index_card(board, of, shown[board.name]) for board, of in tables.items()]
    common: dict[str, Any] = {"version": __version__, "boards": cards, "sensors": _sensors(tables)}
    files = importlib.resources.files("pdrbench_leaderboard") / "page"
    texts = {f"page/{name}": (files / name).read_text(encoding="utf-8") for name in FILES}
    texts["index.html"] = pages.get_template("index.html").render(common)
    for card, of in zip(cards, tables.values(), strict=True):
        name = card["name"]
        facts = {"board": card, "divisions": [_division(one) for one in of], "replays": shown[name]}
        texts[f"{name}.html"] = pages.get_template("board.html").render({**common, **facts})
        texts[f"{name}.json"] = json.dumps(board_json(name, of), indent=1, allow_nan=False) + "\n"
    for name, text in texts.items():
        path = folder / name
        make_folder(path.parent)
        write_whole(path, text.encode())
        written.append(path)
    return written


def _templates() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("pdrbench_leaderboard", "page"),
        autoescape=True,
        finalize=plain_value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"web": web_address, "parts": lambda text: text.split("`"), "breaks": _with_breaks}
    return environment


def _with_breaks(name: str) -> Markup:
    """A name that may be broken after an underscore."""
    return Markup("_<wbr>").join(escape(part) for part in name.split("_"))


def web_address(url: str) -> str:
    """An address that may become a link: http or https, nothing else; else empty.

    >>> web_address("https://example.org/a"), web_address("javascript:alert(1)"), web_address(" http://x")
    ('https://example.org/a', '', '')
    """
    return url if re.fullmatch(r"https?://[^\s<>\"'\\]+", url) else ""


def _sensors(tables: Mapping[Board, Sequence[Table]]) -> list[str]:
    """Sensors that any entry reads, in the order of the house."""
    used = {name for of in tables.values() for one in of for entry in one.entries for name in entry.card.sensors_used}
    return [name for name in SENSORS if name in used]


def _index_card(board: Board, tables: Sequence[Table], replays: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What the index shows of a board, with the walk on which its first entries differ most."""
    online = tables[0] if tables else None
    facts = separability(board, tables)
    return {
        "name": board.name,
        "title": board.title,
        "score_title": board.score_title,
        "summary": board.summary,
        "start": not any(listed.is_lost for listed in board.environments),
        "replays": replays[:1],
        "rows": [_shown(row) for row in online.rows] if online is not None else [],
        "first": FIRST,
        "environments": [listed.env for listed in board.environments],
        "walks": sum(len(of.walks) for of in online.walks.values()) if online is not None else 0,
        "pairs": facts.pairs,
        "significant": facts.significant,
        "smallest": _smallest(online),
    }


def _smallest(found: Table | None) -> str:
    smallest = math.nan if found is None or found.ranking is None else found.ranking.smallest_ratio()
    return f"{smallest:.2f}" if math.isfinite(smallest) else ""


def _shown(row: Row) -> dict[str, Any]:
    """One entry as pages show it."""
    card = row.entry.card
    return {
        "name": row.name,
        "rank": table.rank_text(row),
        "score": table.number(row.standing.score_m),
        "span": table.span(row.standing.low_m, row.standing.high_m),
        "ratio": table.ratio_text(row),
        "walks": table.walks_text(row),
        "is_complete": row.is_complete,
        "cells": table.cells(row),
        "sensors": card.sensors_used,
        "map": card.map_used,
        "survey": card.survey_used,
        "card": card,
        "spec": row.entry.record.spec,
    }


def _division(found: Table) -> dict[str, Any]:
    """What the page of a board shows of a division."""
    head, lines = table.strata_of(found)
    return {
        "name": found.division,
        "title": table.DIVISION_TITLES[found.division],
        "head": [name for name in table.shown_head(found) if name not in ("rank", "entry", table.SCORE, "uses")],
        "rows": [_shown(row) for row in found.rows],
        "order": pictures.order_picture(found),
        "ties": bool(found.ranking and found.ranking.ties),
        "notes": list(table.notes(found)),
        "environments": table.environment_lines(found),
        "strata_head": [name.strip("`") for name in head],
        "strata": lines,
    }


def board_json(name: str, tables: Sequence[Table]) -> dict[str, Any]:
    """A board as numbers."""
    rows = []
    for of in tables:
        for row in of.rows:
            plain = {key: value for key, value in dataclasses.asdict(row.standing).items() if key != "rank"}
            values = {key: getattr(row, key) for key in ("mean_m", "p75_m", "p95_m", "lost", "coverage", "load")}
            finite = {
                key: value if not isinstance(value, float) or math.isfinite(value) else None
                for key, value in (plain | values).items()
            }
            rows.append({"division": of.division, "rank": list(row.standing.rank), **finite})
    return {"board": name, "rows": rows}


def replays(found: Table) -> list[dict[str, Any]]:
    """Public walks on which the first that played them and those after it differ most; none where truth is not here.

    Those of the last time are kept in the cache.
    """
    rows = [row for row in found.rows if found.values(row.entry, part="public")][:3]
    candidates = []
    for listed in found.board.environments:
        walks = found.walks.get((listed.env, "public"))
        if walks is None or not found.board.round(walks.round).secret:
            continue
        for other in rows[1:]:
            values = [found.values(row.entry, part="public").get(listed.env) for row in (rows[0], other)]
            if values[0] is None or values[1] is None:
                continue
            gap = np.abs(np.log(values[0] / values[1]))
            for place in np.argsort(-np.nan_to_num(gap))[:2].tolist():
                if math.isfinite(gap[place]):
                    candidates.append((float(gap[place]), listed.env, place, other))
    candidates.sort(key=lambda candidate: -candidate[0])
    shown: set[tuple[str, int]] = set()
    memory, made, code = f"replays-{found.board.name}.json", dict[str, dict[str, Any]](), package_sha256(__package__)
    known = remembered(memory)
    for _, env, place, other in candidates:
        if (env, place) not in shown and len(made) < REPLAYS:
            shown.add((env, place))
            played = [(row.name, row.entry.record.answers_sha256) for row in (rows[0], other)]
            key = result_key({"walk": (env, found.walks[env, "public"].sha256, place), "by": played, "code": code})
            with contextlib.suppress(DatasetError):
                made[key] = known.get(key) or _replay(found, env, place, (rows[0], other))
    if made.keys() != known.keys():
        remember(memory, made)
    return list(made.values())


def _replay(found: Table, env: str, place: int, pair: tuple[Row, Row]) -> dict[str, Any]:
    """Names and errors of two entries on a walk, the picture, and the data of the script that moves the spots."""
    walks = found.walks[env, "public"]
    listed = found.board.environment(env)
    task = listed.task()
    ids = opaque_names(listed, "public", found.board.round(walks.round).secret)
    recording = task.load(ids[walks.walks[place].name])
    truth = make_truth(task, recording)
    reference = truth.reference
    first = sum(walk.moments for walk in walks.walks[:place])
    tracks = {"real": reference.xy_m}
    errors = []
    for name, row in zip("ab", pair, strict=True):
        division = found.divisions(row.entry, "public")[env]
        whole, _ = answers.decode(read_answers(row.entry.folder), row.name, division.begin)
        rows = whole[:, first : first + len(reference)]
        xy_m = answers.from_whole_numbers(rows, reference.t_s, answers.COARSE).xy_m
        tracks[name] = np.where(np.isfinite(xy_m), xy_m, truth.fallback.xy_m)
        errors.append(float(found.values(row.entry, part="public")[env][place]))
    levels, counts = np.unique(reference.level, return_counts=True)
    level = int(levels[counts.argmax()])  # of most of the walk
    here = reference.level == level
    picture = pictures.plan_picture(
        recording.building,
        level,
        {name: xy_m[here] for name, xy_m in tracks.items()},
        label=f"a walk of {env} with the answers of {pair[0].name} and {pair[1].name}",
    )
    data = {name: pictures.rounded(xy_m[here]) for name, xy_m in tracks.items()}
    data["t_s"] = np.round(reference.t_s[here], 1).tolist()
    return {"names": [row.name for row in pair], "errors_m": errors, "picture": picture, "data": json.dumps(data)}
