from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from pdrbench_lab.readers.foot_vicon_labels import DETECTORS, read_published


def test_published_columns_keep_their_names(tmp_path: Path) -> None:
    labels = {f"zv_{name}_opt": np.full((1, 400), number % 2) for number, name in enumerate(DETECTORS)}
    errors_m = np.array([[0.1, 0.2, 0.2, 0.3, 0.4]])
    file = tmp_path / "trial.mat"
    savemat(file, {"imu": np.ones((400, 6)), "ts": 5.0 + np.arange(400)[None] / 200, "trial_error": errors_m, **labels})
    published = read_published(file)
    assert dict(published.error_m) == {"shoe": 0.1, "ared": 0.2, "mbgtd": 0.3, "vicon": 0.4}
    assert {name: bool(labels.all()) for name, labels in published.zero_velocity.items()} == {
        "shoe": False, "ared": True, "amvd": False, "mbgtd": True, "vicon": False,
    }  # fmt: skip
    assert published.t_s[0] == 0.0 and len(published.t_s) == 400


@pytest.mark.data
def test_the_third_error_repeats_the_second(data_root: Path) -> None:
    paths = sorted((data_root / "foot_vicon" / "data").glob("*.mat"))[:6]
    if not paths:
        pytest.skip("foot_vicon is not under PDRBENCH_DATA")
    for path in paths:
        raw = loadmat(path)
        assert raw["trial_error"][0, 1] == raw["trial_error"][0, 2]
