from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench_lab.readers.foot_dual import PLACES, read


def write(folder: Path, indices: range = range(20)) -> Path:
    """A walk of 20 samples whose right foot goes one metre a sample to the left of a left-handed frame."""
    rows = [f"{i},{0.1 + 0.01 * i},{0.2 + 0.02 * i},9.8{i},{0.01 * i},{0.02 * i},{0.03 * i},1" for i in range(20)]
    path = folder / "imuMeasRight.csv"
    path.write_text("time_index,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z,is_zero_vel\n" + "\n".join(rows))
    places = [f"{i},9,9,9,0.5,{i}.0,0.25" for i in indices]
    head = ",".join(["time_index", *(f"pos_{side}_{axis}" for side in ("left", "right") for axis in "xyz")])
    (folder / PLACES).write_text(head + "\n" + "\n".join(places))
    return path


def test_samples_places_and_frame(tmp_path: Path) -> None:
    log = read(write(tmp_path))
    np.testing.assert_allclose(log.rows["gyro"][:, 1], 0.01 * np.arange(20))
    np.testing.assert_allclose(log.rows["accel"][:, 0], np.arange(20) / 60)
    np.testing.assert_allclose(log.reference.xy_m, np.column_stack([np.full(20, 0.5), -np.arange(20.0)]))
    assert log.reference.z_m is not None and (log.reference.z_m == 0.25).all()


def test_places_of_another_walk_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"imuMeasRight\.csv: its indices are not those of positionGt\.csv"):
        read(write(tmp_path, range(1, 21)))
