from __future__ import annotations

from pathlib import Path

import pytest

from pdrbench.io.log import Log
from pdrbench_sim.readers import ilc20


@pytest.fixture(scope="session")
def mall_logs(data_root: Path) -> dict[Path, Log]:
    """All 124 walks of `ilc20` by path."""
    walks = sorted((data_root / "ilc20").glob("*/*/*/*.txt.gz"))
    assert len(walks) >= 124
    return {path: ilc20.read(path) for path in walks}
