from __future__ import annotations

import numpy as np
import pytest

from pdrbench.inertial import DETECTORS
from pdrbench.inertial.zero_velocity import statistic
from pdrbench_lab.foot_ins import bench as inertial


@pytest.mark.parametrize("kind", ["shoe", "are", "mv", "mag", "soft"])
def test_both_detectors_do_the_same(kind: str) -> None:
    measured = inertial._measured(1, 1)
    compiled, plain = (inertial._detected(kind, of, *measured) for of in (statistic, inertial.plain_statistic))
    np.testing.assert_allclose(compiled, plain, rtol=1e-9)
    assert kind in DETECTORS
