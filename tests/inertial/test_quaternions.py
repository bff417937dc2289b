"""The quaternions of the toolbox against SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pdrbench.inertial import quaternions


def wxyz(rotation: Rotation) -> np.ndarray:
    return rotation.as_quat(scalar_first=True)


@pytest.fixture
def angles(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1.2, 1.2, (50, 3))


def same_attitude(ours: np.ndarray, theirs: Rotation) -> None:
    np.testing.assert_allclose(ours * np.sign((ours * wxyz(theirs)).sum(axis=1))[:, None], wxyz(theirs), atol=1e-12)


def test_angles_products_and_inverses(angles: np.ndarray) -> None:
    ours, theirs = quaternions.from_yaw_pitch_roll(*angles.T), Rotation.from_euler("ZYX", angles)
    same_attitude(ours, theirs)
    same_attitude(quaternions.multiply(ours, ours[::-1]), theirs * theirs[::-1])
    same_attitude(quaternions.inverse(ours), theirs.inv())
    same_attitude(quaternions.about_vertical(angles[:, 0]), Rotation.from_euler("z", angles[:, :1]))


def test_vectors_from_body_to_world(angles: np.ndarray, rng: np.random.Generator) -> None:
    theirs, vectors = Rotation.from_euler("ZYX", angles), rng.standard_normal((50, 3))
    np.testing.assert_allclose(quaternions.to_world(wxyz(theirs), vectors), theirs.apply(vectors), atol=1e-12)


@pytest.mark.parametrize("heading_rad", [0.0, 1.0, np.pi / 2, -2.5])
@pytest.mark.parametrize("tilt_rad", [0.0, 0.5, 1.2])
def test_heading_is_that_of_the_top_edge_whatever_the_tilt(heading_rad: float, tilt_rad: float) -> None:
    # the phone's y axis points north at rest; tilting about its x axis raises the top edge and keeps its direction
    attitude = wxyz(Rotation.from_euler("z", heading_rad - np.pi / 2) * Rotation.from_euler("x", tilt_rad))
    assert quaternions.phone_heading_rad(attitude) == pytest.approx(heading_rad)
    assert quaternions.phone_heading_rad(-attitude) == pytest.approx(heading_rad)
