"""Windows in PyTorch's loader, with what is changed of them in training."""

from __future__ import annotations

import numpy as np
import pytest

import pdrbench
from pdrbench_lab.learned.changes import any_yaw, lower_rate, noise, other_mounting

torch = pytest.importorskip("torch")


def test_batches_are_the_same_for_any_number_of_workers_and_turn_with_their_targets() -> None:
    plain = pdrbench.windows("CampusPhone-v1", walks=1)
    errors = noise({"simulated phone": {"accel": (0.1, 0.05)}})
    changed = plain.changed(any_yaw, other_mounting(0.1), lower_rate(20.0), errors, seed=3)
    found = []
    for workers in (0, 1, 2, 4):
        batches = changed.batches(32, ("building", "person"), count=3)
        loader = torch.utils.data.DataLoader(changed, sampler=batches, batch_size=None, num_workers=workers)
        found.append([torch.cat([x.flatten(), y.flatten()]) for x, y in loader])
    assert all(torch.equal(a, b) for other in found[1:] for a, b in zip(found[0], other, strict=True))
    (x, y), (turned_x, turned_y) = plain[:300], plain.changed(any_yaw)[:300]
    x, turned_x = (one[:, -3] + 1j * one[:, -2] for one in (x, turned_x))  # rates about axes that lie level
    y, turned_y = y @ [1, 1j], turned_y @ [1, 1j]
    moves = np.abs(y) > 0.1
    np.testing.assert_allclose((turned_x / (turned_y / y)[:, None])[moves], x[moves], atol=1e-4)
    off = plain.changed(noise({"simulated phone": {"accel": (0.5, 0.0)}}))[:300][0] - plain[:300][0]
    assert off[:, :3].std() == pytest.approx(0.5, rel=0.02)  # of 45 000 draws: 6 sigma
    assert not off[:, 3:].any()
