"""Localizers on environments: walks and seeds, in processes, under deadlines, stored, scored. Nothing else loops."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pdrbench.evaluation.own_arrays import Replayed, replay
    from pdrbench.evaluation.scoring import score
    from pdrbench.evaluation.sweep import evaluate
    from pdrbench.evaluation.tables import Results, load_results
    from pdrbench.evaluation.trace import Frame, retrace

_HOMES = {
    "Frame": "trace",
    "Replayed": "own_arrays",
    "Results": "tables",
    "evaluate": "sweep",
    "load_results": "tables",
    "replay": "own_arrays",
    "retrace": "trace",
    "score": "scoring",
}

__all__ = ["Frame", "Replayed", "Results", "evaluate", "load_results", "replay", "retrace", "score"]


def __getattr__(name: str) -> Any:
    """Loads a public name when it is first asked for: joblib and pandas stay out of `import pdrbench`."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pdrbench.evaluation' has no attribute {name!r}")
    return getattr(importlib.import_module(f"pdrbench.evaluation.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
