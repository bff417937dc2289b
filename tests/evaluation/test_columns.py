"""Which metrics a table shows besides the usual ones."""

from __future__ import annotations

from typing import Any

import pytest

from pdrbench.evaluation.wording import shown_besides


def row(start: str = "pose", **values: float | None) -> dict[str, Any]:
    """A row of a table; a metric without a value applies to no walk."""
    metrics = {name: {"value": value, "n": 0 if value is None else 7} for name, value in values.items()}
    return {"start": start, "metrics": metrics}


DENSE = {"ate_se2_aligned_m": 0.1, "ate_se2_translation_only": 0.0, "loop_closure_pct": None}
BOTH_ENDS = {"ate_se2_aligned_m": 0.0, "ate_se2_translation_only": 1.0, "loop_closure_pct": 0.4}


@pytest.mark.parametrize(
    ("rows", "shown"),
    [
        ([row(**DENSE, outside_pct=None)], ["ate_se2_aligned_m"]),
        ([row(**BOTH_ENDS, outside_pct=None)], ["loop_closure_pct"]),
        ([row(**BOTH_ENDS), row(**DENSE)], ["ate_se2_aligned_m", "loop_closure_pct"]),
        ([row(**DENSE, outside_pct=2.0)], ["outside_pct"]),
        ([row("unknown", **DENSE)], []),
        ([row("unknown", **DENSE, convergence_s=3.0)], ["convergence_s"]),
        ([row(energy_score_m=3.0)], ["energy_score_m"]),
        ([row()], []),
    ],
    ids=[
        "a place at every stride",
        "both ends of a loop",
        "both kinds",
        "on a map",
        "lost",
        "found",
        "claims",
        "all declined",
    ],
)
def test_walks_without_a_map_are_aligned_and_closed(rows: list[dict[str, Any]], shown: list[str]) -> None:
    assert shown_besides(rows) == shown
