"""The registered localizers on the registered synthetic office."""

from __future__ import annotations

import pytest

from pdrbench.evaluation import evaluate


@pytest.mark.slow
def test_stay_and_oracle_bracket_dead_reckoning_and_processes_change_nothing() -> None:
    names = ["stay-v0", "dead_reckoning-v0", "oracle-v0", "wifi_knn-v0"]
    results = evaluate(names, "OfficeStride-v0", split="val", walks=2, jobs=2)
    stay, reckoned, oracle = (row["metrics"]["mean_m"]["value"] for row in results.rows()[:3])
    assert oracle < 1e-6 < reckoned < stay
    assert {r.status for r in results.results if r.localizer == "wifi_knn-v0"} == {"unsuitable"}
    here = evaluate(names, "OfficeStride-v0", split="val", walks=2, isolation="none")
    for one, other in zip(results.results, here.results, strict=True):
        assert one.estimates.xy_m.tobytes() == other.estimates.xy_m.tobytes()
