from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import UnknownNameError
from pdrbench_lab.readers.fingerprint_sets import other_sets, read_set


def test_a_set_of_ones_own_is_read_as_its_table_says(tmp_path: Path) -> None:
    head, row = "MAC1,MAC2,ECoord,NCoord,FloorID,UserID", "-40,100,1.5,2.5,3,7"
    (tmp_path / "CETC331").mkdir()
    for part in ("Training", "Testing"):
        (tmp_path / "CETC331" / f"{part}_CETC331.csv").write_text(f"{head}\n{row}\n")
    found = read_set("SOD_CETC331", tmp_path).train
    np.testing.assert_array_equal(found.rssi_dbm, [[-40, np.nan]])
    assert (found.xy_m.tolist(), found.level.tolist()) == ([[1.5, 2.5]], [3])
    with pytest.raises(UnknownNameError, match="SOD_SYL"):
        read_set("SOD_SIL", tmp_path)
    assert all({"train", "test", "missing", "licence", "source"} <= of.keys() for of in other_sets().values())
