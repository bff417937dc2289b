"""Can a classifier tell real walks from synthetic ones? The area under its ROC curve: 0.5 no, 1 always."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray

FOLDS: Final = 5
REPEATS: Final = 5  # different ways to cut the folds: their mean hardly depends on the cut
MIN_WALKS: Final = 10  # walks of each kind: with fewer the area is a matter of chance
MIN_RELATIVE_SPREAD: Final = 1e-12  # relative spread below which a feature is a constant


@dataclass(frozen=True, slots=True)
class SeparabilityResult:
    """How well the classifier did.

    Attributes:
        auc: Mean area under the ROC curve over held-out folds; NaN where there were too few walks.
        num_real: Walks that had every feature.
        num_synthetic: The same.
        why: Why there is no area, or which feature weighs most.
    """

    auc: float
    num_real: int
    num_synthetic: int
    why: str


def separability(
    real: Mapping[str, Sequence[float | None] | FloatArray],
    synthetic: Mapping[str, FloatArray],
    features: Sequence[str],
) -> SeparabilityResult:
    """Logistic regression on standardised features, judged on walks that it has not seen.

    The two-sample test of D. Lopez-Paz, M. Oquab, "Revisiting classifier two-sample tests", ICLR 2017. Folds are
    stratified and fixed; a walk is one row and so in one fold. Below 0.5 the area is left as it is: folds do that by
    chance where there is nothing to tell.

    Args:
        real: (n,) by feature, walks in one order.
        synthetic: (m,) the same.
        features: Names, in the order of the columns.
    """
    missing = [name for name in features if name not in real or name not in synthetic]
    if missing:
        return SeparabilityResult(math.nan, 0, 0, f"no values of the feature {missing[0]!r}")
    if len({len(real[name]) for name in features}) > 1 or len({len(synthetic[name]) for name in features}) > 1:
        return SeparabilityResult(math.nan, 0, 0, "features have different numbers of walks")
    ours, theirs = _whole_rows(real, features), _whole_rows(synthetic, features)
    if min(len(ours), len(theirs)) < MIN_WALKS:
        why = f"{len(ours)} real and {len(theirs)} synthetic walks with every feature; at least {MIN_WALKS} are needed"
        return SeparabilityResult(math.nan, len(ours), len(theirs), why)
    x, y = np.vstack([ours, theirs]), np.repeat([1, 0], [len(ours), len(theirs)])
    varies = np.std(x, axis=0) > MIN_RELATIVE_SPREAD * np.abs(x).max(axis=0)
    if not varies.any():
        return SeparabilityResult(0.5, len(ours), len(theirs), "every feature is a constant")
    auc, weight = _cross_validated(x[:, varies], y)
    heaviest = [name for name, kept in zip(features, varies, strict=True) if kept][int(np.argmax(weight))]
    return SeparabilityResult(auc, len(ours), len(theirs), f"{heaviest!r} weighs most")


def _whole_rows(columns: Mapping[str, Sequence[float | None] | FloatArray], features: Sequence[str]) -> FloatArray:
    """(n, F) walks that have every feature."""
    rows = np.column_stack([np.array(columns[name], dtype=np.float64) for name in features])
    return rows[np.isfinite(rows).all(axis=1)]


def _cross_validated(x: FloatArray, y: FloatArray) -> tuple[float, FloatArray]:
    """Mean area over the folds, and (F,) the size of each feature's weight in a fit to everything."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.model_selection import RepeatedStratifiedKFold, cross_val_score
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    model = make_pipeline(StandardScaler(), LogisticRegression(class_weight="balanced", max_iter=1000))
    folds = RepeatedStratifiedKFold(n_splits=FOLDS, n_repeats=REPEATS, random_state=0)
    areas = cross_val_score(model, x, y, cv=folds, scoring="roc_auc")
    model.fit(x, y)
    return float(np.mean(areas)), np.abs(model[-1].coef_[0])
