"""Pages across leaderboards: a suite as a table of ranks and scores, and a localizer on every environment."""

from __future__ import annotations

import importlib.util
import io
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pdrbench.evaluation.origin import localizer_target
from pdrbench.metrics import METRICS
from pdrbench.registry import localizers
from pdrbench_leaderboard import downloads
from pdrbench_leaderboard.ranking import Board, Standing

DISTRIBUTION: Final = "pdrbench"  # whose source may be handed on
ZIP_DATE: Final = (1980, 1, 1, 0, 0, 0)  # of every member: the same source gives the same bytes


@dataclass(frozen=True, slots=True)
class Place:
    """A localizer on one leaderboard."""

    board: Board
    standing: Standing

    @property
    def of(self) -> int:
        """How many are ranked in its division."""
        return sum(other.row["division"] == self.standing.row["division"] for other in self.board.ranked)

    @property
    def fraction_ahead(self) -> float | None:
        """Of the others of its division, the fraction ahead: 0 is first, 1 is last; None where it has no rank."""
        if self.standing.rank is None:
            return None
        return (self.standing.rank - 1) / max(1, self.of - 1)


def places(boards: Sequence[Board]) -> dict[str, list[Place]]:
    """Every localizer by name, with its places in the order of the boards."""
    found: dict[str, list[Place]] = {}
    for board in boards:
        for standing in board.standings:
            found.setdefault(standing.name, []).append(Place(board, standing))
    return dict(sorted(found.items()))


def slugs(names: Sequence[str]) -> dict[str, str]:
    """A file name for each name that every file system takes, no two alike."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", name).strip(".") or "entry"
        candidates = (plain, *(f"{plain}-{n}" for n in range(2, len(names) + 2)))
        slug = next(candidate for candidate in candidates if candidate.lower() not in taken)
        taken.add(slug.lower())
        found[name] = slug
    return found


def suite_facts(suite: str, boards: Sequence[Board], entry_slugs: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """Ranks and scores of every localizer on every environment of a suite; slugs of entries by environment and name.

    Rows are in the order of the mean fraction of others ahead over the environments on which a localizer is ranked: a
    way to sort them, not a score.
    """
    here = [board for board in boards if any(standing.entry.suite == suite for standing in board.standings)]
    lines: list[dict[str, Any]] = []
    for name, of in places(here).items():
        by_env = {place.board.task.id: place for place in of if place.standing.entry.suite == suite}
        ahead = [found for place in by_env.values() if (found := place.fraction_ahead) is not None]
        cells = [_cell(by_env.get(board.task.id), entry_slugs) for board in here]
        mean = sum(ahead) / len(ahead) if ahead else None
        lines.append({"name": name, "cells": cells, "ranked": len(ahead), "mean": mean})
    lines.sort(key=lambda line: (line["mean"] is None, line["mean"] or 0.0, -line["ranked"], line["name"]))
    envs = [{"env": board.task.id, "summary": board.task.summary.rstrip(".")} for board in here]
    return {"name": suite, "envs": envs, "lines": lines}


def _cell(place: Place | None, entry_slugs: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """One localizer on one environment; empty where it was not entered."""
    if place is None:
        return {}
    standing, metric, env = place.standing, place.board.metric, place.board.task.id
    return {
        "label": standing.label,
        "of": place.of,
        "ahead": place.fraction_ahead,
        "value": standing.held_out or standing.public,
        "is_public": not standing.held_out,
        "metric": metric,
        "unit": METRICS[metric].unit,
        "tier": standing.entry.tier,
        "division": standing.row["division"],
        "why_unranked": standing.why_unranked,
        "env": env,
        "link": f"{env}/entries/{entry_slugs[env][standing.name]}.html",
    }


def localizer_facts(name: str, of: Sequence[Place], entry_slugs: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """A localizer on every environment that it was entered on."""
    cells = [_cell(place, entry_slugs) for place in of]
    return {"name": name, "card": downloads.card_facts(of[0].standing), "cells": cells}


def source_archive(spec: str) -> bytes | None:
    """The code of a localizer of this distribution: its module, or the folder that it lies in; None for others."""
    if spec not in localizers() or localizers()[spec].package != DISTRIBUTION:
        return None
    module = localizer_target(spec).partition(":")[0]
    found = importlib.util.find_spec(module)
    if found is None or found.origin is None:
        return None
    top, file = Path(found.origin).parents[module.count(".")], Path(found.origin)
    files = [file] if file.parent.parent == top else sorted(file.parent.rglob("*.py"))
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in files:
            name = path.relative_to(top).as_posix()
            archive.writestr(zipfile.ZipInfo(name, ZIP_DATE), path.read_bytes(), zipfile.ZIP_DEFLATED)
    return content.getvalue()
