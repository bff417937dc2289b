"""A classifier that separates real from synthetic walks: the area under its ROC curve is 0.5 where it cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench_sim.realism.block import Verdict

FOLDS: Final = 5
REPEATS: Final = 5  # different ways to cut the folds: their mean hardly depends on the cut
MIN_WALKS: Final = 10  # walks of each kind: with fewer the area is a matter of chance
MIN_RELATIVE_SPREAD: Final = 1e-12  # relative spread below which a feature is a constant


def separability(
    real: Mapping[str, Sequence[float | None] | FloatArray],
    synthetic: Mapping[str, FloatArray],
    features: Sequence[str],
    max_auc: float,
) -> tuple[Verdict, tuple[int, int]]:
    """Logistic regression on standardised features, judged on walks that it has not seen.

    The two-sample test of D. Lopez-Paz, M. Oquab, "Revisiting classifier two-sample tests", ICLR 2017. Folds are
    stratified and fixed; a walk is one row and so in one fold. An area below 0.5 is left as it is: it occurs by chance
    where nothing separates the walks.

    Args:
        real: (n,) by feature, walks in one order.
        synthetic: (m,) the same.
        features: Names, in the order of the columns.
        max_auc: Largest mean area under the ROC curve over held-out folds that passes.

    Returns:
        The verdict, with the area as distance, and the numbers of real and synthetic walks that have every feature.
    """
    missing = [name for name in features if name not in real or name not in synthetic]
    if missing:
        return Verdict(unknown=f"no values of the feature {missing[0]!r}"), (0, 0)
    if len({len(real[name]) for name in features}) > 1 or len({len(synthetic[name]) for name in features}) > 1:
        return Verdict(unknown="features have different numbers of walks"), (0, 0)
    ours, theirs = _whole_rows(real, features), _whole_rows(synthetic, features)
    counts = len(ours), len(theirs)
    if min(counts) < MIN_WALKS:
        few = f"{counts[0]} real and {counts[1]} synthetic walks with every feature; at least {MIN_WALKS} are needed"
        return Verdict(unknown=few), counts
    x, y = np.vstack([ours, theirs]), np.repeat([1, 0], counts)
    varies = np.std(x, axis=0) > MIN_RELATIVE_SPREAD * np.abs(x).max(axis=0)
    if not varies.any():
        return Verdict(0.5, remark="every feature is a constant"), counts
    auc, weight = _cross_validated(x[:, varies], y)
    why = f"{[name for name, kept in zip(features, varies, strict=True) if kept][int(np.argmax(weight))]!r} weighs most"
    if auc <= max_auc:
        return Verdict(auc, remark=why), counts
    return Verdict(auc, (f"AUC {auc:.2f} > {max_auc:g}: {why}",)), counts


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
