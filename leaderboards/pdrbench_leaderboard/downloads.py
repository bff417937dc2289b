"""A leaderboard for programs: JSON and CSV."""

from __future__ import annotations

import csv
import gzip
import io
import math
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.evaluation.wording import counted
from pdrbench.geometry import FloatArray
from pdrbench.metrics import METRICS
from pdrbench.trajectory import ESTIMATE_COLUMNS
from pdrbench_leaderboard import page_data
from pdrbench_leaderboard.ranking import SIGNIFICANT, Board, Standing

HIDDEN: Final = frozenset({"contact"})  # of a card: addresses stay in the repository, where robots look less
COLUMNS: Final = (
    "mean_m",
    "pooled_mean_m",
    "p95_m",
    "level_hit_rate",
    "availability",
    "step_p50_ms",
)  # of the CSV, beside the first


def board_facts(board: Board) -> dict[str, Any]:
    """What the pages say of a board beside its rows."""
    task, metric = board.task, METRICS[board.metric]
    return {
        "env": task.id,
        "summary": task.summary.rstrip("."),
        "metric": metric.name,
        "unit": metric.unit,
        "better": metric.better,
        "what": metric.what,
        "walks": len(board.walks),
        "held_out_walks": len(board.held_out_units),
        "buildings": len(set(board.buildings) - {""}),
        "units": counted(task.unit_kind, len(set(board.units))),
        "sensors": [spec.name for spec in task.sensors],
        "tiers": sorted({standing.entry.tier for standing in board.standings}),
        "licence": task.licence,
        "source": task.source,
        "note": task.note,
        "is_public": page_data.is_public(board),
        "significant": SIGNIFICANT,
        "suites": sorted({standing.entry.suite for standing in board.standings}),
    }


def card_facts(standing: Standing) -> dict[str, Any]:
    card: dict[str, Any] = msgspec.to_builtins(standing.entry.card)
    return {name: value for name, value in card.items() if name not in HIDDEN}


def board_json(board: Board) -> dict[str, Any]:
    """A leaderboard for programs: `{"board": facts, "entries": [...]}`; `metrics` as `compare --json` prints them."""
    entries = []
    for standing in board.standings:
        entries.append(
            {
                "localizer": standing.name,
                "rank": standing.rank,
                "why_unranked": standing.why_unranked,
                "division": standing.row["division"],
                "tier": standing.entry.tier,
                "suite": standing.entry.suite,
                "walks": standing.row["walks"],
                "seeds": standing.row["seeds"],
                "failed": standing.row["failed"],
                "unsuitable": standing.row["unsuitable"],
                "ahead_of": list(board.beaten_by(standing.name)),
                "card": card_facts(standing),
                "held_out": dict(standing.held_out),
                "public": dict(standing.public),
                "gap": standing.gap,
                "metrics": standing.row["metrics"],
            }
        )
    return {"board": board_facts(board), "entries": entries}


def board_csv(board: Board) -> str:
    """A leaderboard as CSV, one line for each entry."""
    names = list(dict.fromkeys([board.metric, *COLUMNS]))
    head = ["env", "localizer", "rank", "division", "tier", "held_out", "held_out_low", "held_out_high", "gap"]
    head += ["walks", "sensors", "map", "survey"]
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(head + [f"{name}{end}" for name in names for end in ("", "_low", "_high")])
    for standing in board.standings:
        card = board.card(standing)
        facts = [board.task.id, standing.name, standing.rank, standing.row["division"], standing.entry.tier]
        facts += [*map(standing.held_out.get, ("value", "low", "high")), standing.gap]
        facts += [standing.row["walks"], " ".join(card.sensors_used), card.map_used, card.survey_used]
        values = [standing.metric(name).get(key) for name in names for key in ("value", "low", "high")]
        lines.writerow(["" if cell is None else _harmless(cell) for cell in (*facts, *values)])
    return text.getvalue()


def estimates_csv(standing: Standing) -> bytes:
    """Every estimate of an entry as gzipped CSV, one line for each: walk, seed, time, and what was answered."""
    lines = [",".join(["walk", "seed", "t_s", *ESTIMATE_COLUMNS])]
    for result in standing.entry.results:
        columns = [_cells(values) for values in (result.estimates.t_s, *result.estimates.columns)]
        of = io.StringIO()
        csv.writer(of, lineterminator=",").writerow([_harmless(result.walk), result.seed])
        lines += [of.getvalue() + ",".join(row) for row in zip(*columns, strict=True)]
    return gzip.compress("\n".join([*lines, ""]).encode(), compresslevel=6, mtime=0)


def _cells(values: FloatArray) -> list[str]:
    """Numbers as text, nothing where one is missing."""
    if np.isnan(values).all():
        return [""] * len(values)
    return ["" if math.isnan(value) else f"{value:.10g}" for value in values.tolist()]


def _harmless(cell: object) -> object:
    """A cell that no spreadsheet takes for a formula."""
    return f"'{cell}" if isinstance(cell, str) and cell[:1] in ("=", "+", "-", "@", "\t", "\r") else cell
