from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench_formats.interop.minari_export import export_minari


def test_a_train_split_becomes_a_minari_dataset(stride_task, tmp_path, monkeypatch) -> None:
    minari = pytest.importorskip("minari")
    seen = []
    name = export_minari(stride_task, tmp_path, progress=lambda *facts: seen.append(facts))
    assert name == "pdrbench/Served/train-v0" and seen == [(1, 1, "walk-a")]
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    dataset = minari.load_dataset(name)
    (episode,) = dataset.iterate_episodes()
    reference = stride_task.load("walk-a").reference
    num_steps = len(episode.actions)
    assert episode.observations["stride"].shape == (num_steps + 1, 2, 4)
    assert episode.actions[::5][:12] == pytest.approx(np.column_stack([reference.xy_m, reference.level]), abs=1e-9)
    assert np.abs(episode.rewards).max() == 0 and episode.terminations.tolist() == [False] * (num_steps - 1) + [True]
    assert dataset.action_space.shape == (3,)
    with pytest.raises(PdrbenchError, match="exists"):
        export_minari(stride_task, tmp_path)


def test_what_cannot_be_exported_is_refused(stride_task, tmp_path) -> None:
    with pytest.raises(PdrbenchError, match="withheld"):
        export_minari(stride_task, tmp_path, split="test")
    assert not any(tmp_path.iterdir())
