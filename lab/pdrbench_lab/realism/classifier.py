"""A classifier that separates real from synthetic walks: the area under its ROC curve is 0.5 where it cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray
from pdrbench_lab.realism.block import CLASSIFIER, CLUSTER, Verdict

if TYPE_CHECKING:
    from sklearn.pipeline import Pipeline

FOLDS: Final = 5
REPEATS: Final = 5  # different ways to cut the folds: their mean hardly depends on the cut
MIN_WALKS: Final = 10  # walks of each kind: with fewer the area is a matter of chance
MIN_PEOPLE: Final = 3  # to be judged: of one person of the same law the area is anything from 0.2 to 0.9
MIN_RELATIVE_SPREAD: Final = 1e-12  # relative spread below which a feature is a constant
PERSON: Final = f"{CLASSIFIER}{CLUSTER}"  # key of the number of the person of each walk

Columns = Mapping[str, Sequence[float | None] | FloatArray]


def separability(
    real: Columns, synthetic: Columns, features: Sequence[str], max_auc: float
) -> tuple[Verdict, tuple[int, int]]:
    """Logistic regression on standardised features, judged on walks that it has not seen.

    The two-sample test of D. Lopez-Paz, M. Oquab, "Revisiting classifier two-sample tests", ICLR 2017. Folds are
    stratified and fixed; a walk is one row and so in one fold. An area below 0.5 is left as it is: it occurs by chance
    where nothing separates the walks.

    Where both sides say whose walks are whose (`PERSON`), it is judged on people that it has not seen: who knows one
    walk of a person and its unit recognises the others, real or not.

    Args:
        real: (n,) by feature, walks in one order; under `PERSON` the number of the person of each. Of people with a
            negative number it may learn, and it is not judged on them.
        synthetic: (m,) the same.
        features: Names, in the order of the columns.
        max_auc: Largest mean area under the ROC curve over held-out folds that passes.

    Returns:
        The verdict, with the area as distance, and the numbers of real and synthetic walks that have every feature.
    """
    has_people = PERSON in real and PERSON in synthetic
    names = [*features, PERSON] if has_people else list(features)
    missing = [name for name in features if name not in real or name not in synthetic]
    if missing:
        return Verdict(unknown=f"no values of the feature {missing[0]!r}"), (0, 0)
    if len({len(real[name]) for name in names}) > 1 or len({len(synthetic[name]) for name in names}) > 1:
        return Verdict(unknown="features have different numbers of walks"), (0, 0)
    ours, theirs = _whole_rows(real, names), _whole_rows(synthetic, names)
    counts = len(ours), len(theirs)
    if min(counts) < MIN_WALKS:
        few = f"{counts[0]} real and {counts[1]} synthetic walks with every feature; at least {MIN_WALKS} are needed"
        return Verdict(unknown=few), counts
    x = np.vstack([ours, theirs])[:, : len(features)]
    varies = np.std(x, axis=0) > MIN_RELATIVE_SPREAD * np.abs(x).max(axis=0)
    if not varies.any():
        return Verdict(0.5, remark="every feature is a constant"), counts
    x, y = x[:, varies], np.repeat([1, 0], counts)
    few_people = ""
    if has_people:
        person = np.concatenate([ours[:, -1], theirs[:, -1]]).astype(np.int64)
        if len(np.unique(person[y == 1])) < 2:
            return Verdict(unknown="walks of one person: a classifier needs another one to learn from"), counts
        auc, judged = area_for_new_people(x, y, person), len(np.unique(ours[ours[:, -1] >= 0, -1]))
        few_people = "" if judged >= MIN_PEOPLE else f"AUC {auc:.2f} of {judged} new people; {MIN_PEOPLE} are needed"
    else:
        auc = _cross_validated(x, y)
    weight = np.abs(_model().fit(x, y)[-1].coef_[0])
    why = f"{[name for name, kept in zip(features, varies, strict=True) if kept][int(np.argmax(weight))]!r} weighs most"
    if auc <= max_auc:
        return Verdict(auc, unknown=few_people, remark=why), counts
    return Verdict(auc, (f"AUC {auc:.2f} > {max_auc:g}: {why}",)), counts


def _whole_rows(columns: Columns, names: Sequence[str]) -> FloatArray:
    """(n, F) walks that have every feature."""
    rows = np.column_stack([np.array(columns[name], dtype=np.float64) for name in names])
    return rows[np.isfinite(rows).all(axis=1)]


def _model() -> Pipeline:
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    return make_pipeline(StandardScaler(), LogisticRegression(class_weight="balanced", max_iter=1000))


def _cross_validated(x: FloatArray, y: IntArray) -> float:
    """Mean area over the folds."""
    from sklearn.model_selection import RepeatedStratifiedKFold, cross_val_score

    folds = RepeatedStratifiedKFold(n_splits=FOLDS, n_repeats=REPEATS, random_state=0)
    return float(np.mean(cross_val_score(_model(), x, y, cv=folds, scoring="roc_auc")))


def area_for_new_people(x: FloatArray, y: IntArray, person: IntArray) -> float:
    """Mean area over judged walks: each real person of number 0 or more against the synthetic people of each fold.

    Args:
        x: (n, F) features of walks.
        y: (n,) 1 for real ones.
        person: (n,) number of the person, counted from 0 on either side.
    """
    from sklearn.metrics import roc_auc_score

    real = y == 1
    synthetic = np.unique(person[~real])
    fold_of = {int(who): k % FOLDS for k, who in enumerate(np.random.default_rng(0).permutation(synthetic))}
    fold = np.array([-1 if is_real else fold_of[int(who)] for who, is_real in zip(person, real, strict=True)])
    areas, walks = [], []
    for judged in np.unique(person[real & (person >= 0)]):
        is_judged = real & (person == judged)
        for k in range(FOLDS):
            test = is_judged | (fold == k)
            learns = ~test & ~is_judged
            scores = _model().fit(x[learns], y[learns]).decision_function(x[test])
            areas.append(float(roc_auc_score(y[test], scores)))
            walks.append(int(is_judged.sum()))
    return float(np.average(areas, weights=walks))
