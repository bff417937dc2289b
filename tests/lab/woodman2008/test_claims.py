from __future__ import annotations

import numpy as np

from pdrbench_lab.papers.woodman2008.claims import REPRODUCTION
from pdrbench_lab.papers.woodman2008.experiments import Run


def test_every_claim_of_the_paper_is_listed() -> None:
    listed = {claim.id for claim in REPRODUCTION.claims}
    assert listed == {"W1", "W4", *(f"W{number}" for number in range(6, 19))}


def test_a_run_converges_at_its_first_claim() -> None:
    one = Run(
        prior_particles=10,
        error_m=np.array([20.0, 2.9, 2.9, 3.1]),
        xy_m=np.zeros((4, 2)),
        height_m=np.zeros(4),
        height_error_m=np.array([0.0, 1.6, 1.4, 0.0]),
        converged=np.array([False, False, True, False]),
        num_particles=np.full(4, 32),
        num_bins=np.full(4, 2),
        deaths=0,
    )
    assert one.first == 2
    assert one.correct.tolist() == [False, False, True, False]
    assert one.is_correct(one.first) and not one.is_correct(4)


def test_tracking_begins_where_a_single_cluster_is_small_and_ends_where_there_is_none() -> None:
    """W15: a cluster that has not yet shrunk to what the paper's 500 particles occupy is still a search."""
    converged = np.array([False, True, True, True, False, True, True])
    bins = np.array([5, 400, 36, 90, 5, 8, 37])
    nothing = np.zeros(7)
    one = Run(0, nothing, np.zeros((7, 2)), nothing, nothing, converged, bins, bins, deaths=0)
    assert one.tracks.tolist() == [False, False, True, True, False, False, False]
    assert converged.tolist() == [False, True, True, True, False, True, True]
