from __future__ import annotations

import numpy as np
import pytest

from pdrbench_baselines.koeping2012.movement import build_table
from pdrbench_lab.papers.woodman2008.lab_stride.lab import make_lab


def test_the_table_of_the_laboratory_fits_into_memory() -> None:
    table = build_table(make_lab(np.random.default_rng(0)))
    assert table.cells.area_m2.sum() == pytest.approx(8725, rel=0.01)
    assert table.nbytes < 40e6
    assert 35_000 < table.num_cells < 60_000
