"""`pdrbench data add kaggle_iln FOLDER`: what lies there, indexed once and remembered."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pdrbench_envs.retail.buildings import index_all, plan_of
from pdrbench_envs.retail.sources import DATASET, add, secret_walks, sites

LOG_EVERY = 10  # buildings


def add_kaggle_iln(folder: Path, log: Callable[[str], None]) -> tuple[dict[str, Any], list[str]]:
    """Remembers a copy, and reads every building of all copies.

    Args:
        folder: Folder or zip archive.
        log: Takes lines of progress.

    Returns:
        What was found, and the lines that say it.
    """
    place = add(folder)
    names = list(sites())
    rows: list[dict[str, Any]] = []
    problems: list[str] = []
    for number, index in enumerate(index_all(names, min(len(names), os.cpu_count() or 1)), 1):
        plan, why = plan_of(index.site)
        problems += [*index.problems, *why]
        floors = sorted({walk.level for walk in index.walks})
        levels = [] if plan is None else list(plan.levels)
        rows.append({"site": index.site, "walks": len(index.walks), "levels": floors, "levels_of_plan": levels})
        if number % LOG_EVERY == 0:
            log(f"{DATASET}: {number} of {len(names)} buildings")
    num_walks = sum(row["walks"] for row in rows)
    walked, planned = (sum(bool(row[what]) for row in rows) for what in ("walks", "levels_of_plan"))
    facts = {"folder": str(place), "buildings": rows, "walks": num_walks, "problems": problems}
    facts["secret_walks"] = len(secret_walks())
    said = f"{DATASET}: {num_walks} walks in {walked} buildings, {planned} of them with a plan"
    return facts, [*(f"left out: {problem}" for problem in problems), f"{said}; remembered where they lie: {place}"]
