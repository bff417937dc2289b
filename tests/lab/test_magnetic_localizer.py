"""A magnetic survey of a hall whose field is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing
from pdrbench.recording import MagneticMap
from pdrbench.sensors import sensor_spec
from pdrbench_baselines.learned.map_filter import LearnedMapFilterParams
from pdrbench_lab.magnetic.cloud import MagneticCloud
from pdrbench_lab.magnetic.evidence import MagneticEvidence, MagneticEvidenceParams, OffsetBelief
from pdrbench_lab.magnetic.field import MagneticField, MagneticFieldParams, magnitudes_of
from pdrbench_lab.magnetic.localizer import Magnetic, MagneticFusion

RING = np.array([(0.0, 0.0), (40.0, 0.0), (40.0, 20.0), (0.0, 20.0)])
HALL = Building("hall", (FloorPolygon("hall", RING, np.full(4, WALL), 0.0, 0),))
ROWS_M = (3.0, 6.0, 9.0, 12.0, 15.0, 18.0)
OFFSET_UT = np.array([5.0, -4.0, 6.0])


def true_ut(xy_m: FloatArray) -> FloatArray:
    """(n, 2) horizontal magnitude and vertical part: waves of 20 m to 30 m."""
    x_m, y_m = np.asarray(xy_m).T
    horizontal_ut = 30.0 + 6.0 * np.sin(x_m / 4.0) * np.cos(y_m / 5.0)
    return np.column_stack([horizontal_ut, -30.0 + 7.0 * np.cos(x_m / 3.5 + y_m / 4.0)])


def measured_ut(xy_m: FloatArray, yaw_rad: FloatArray, offset_ut: FloatArray) -> FloatArray:
    """(n, 3) level field of a phone with an offset, the field pointing by so much to the right of its top edge."""
    value_ut = true_ut(xy_m)
    ahead = np.column_stack([np.sin(yaw_rad), np.cos(yaw_rad)])
    return np.column_stack([value_ut[:, :1] * ahead, value_ut[:, 1]]) + offset_ut


def survey(rng: np.random.Generator, offset_ut: float = 4.0) -> MagneticMap:
    """Walks along and across the hall, each of a phone with an offset of its own, one way each."""
    along = [np.column_stack([np.arange(1.0, 39.0, 0.5), np.full(76, y)]) for y in ROWS_M]
    across = [np.column_stack([np.full(36, x), np.arange(1.0, 19.0, 0.5)]) for x in (5.0, 15.0, 25.0, 35.0)]
    samples, walks = [], []
    for walk, (line, yaw) in enumerate([(line, 1.5) for line in along] + [(line, 0.0) for line in across]):
        xy_m = line[:: 1 - 2 * (walk % 2)]
        yaw_rad = np.full(len(line), yaw + np.pi * (walk % 2))
        field_ut = measured_ut(xy_m, yaw_rad, offset_ut * rng.standard_normal(3))
        samples.append(np.column_stack([xy_m, field_ut + 0.5 * rng.standard_normal(field_ut.shape)]))
        walks += [walk] * len(xy_m)
    table = np.concatenate(samples)
    return MagneticMap(table[:, :2], np.zeros(len(table), int), np.array(walks), table[:, 2:])


def places(rng: np.random.Generator, count: int = 200) -> FloatArray:
    return rng.uniform([2.0, 3.0], [38.0, 18.0], (count, 2))


def test_the_field_is_found_through_the_offsets_of_the_walks(rng: np.random.Generator) -> None:
    """Errors are below the offsets, as the variance says; taken for none, the same offsets stay in the field."""
    surveyed, xy_m = survey(rng), places(rng)
    level = np.zeros(len(xy_m), int)

    def off_ut(offset_ut: float) -> tuple[FloatArray, FloatArray]:
        field = MagneticField(surveyed, MagneticFieldParams(nugget_ut=1.0, offset_ut=offset_ut))
        mean_ut, variance_ut2 = field.at(xy_m, level)
        off = mean_ut - true_ut(xy_m)
        return off - off.mean(axis=0), variance_ut2  # an offset of all walks together is no fault of a map

    off, variance_ut2 = off_ut(4.0)
    naive, _ = off_ut(0.0)
    assert (off.std(axis=0) < [2.2, 2.2]).all() and (naive.std(axis=0) > 1.2 * off.std(axis=0)).all()
    assert (off**2 / variance_ut2).mean() < 2.0


def test_far_from_the_survey_and_on_other_levels_nothing_is_known(rng: np.random.Generator) -> None:
    surveyed, p = survey(rng), MagneticFieldParams()
    field = MagneticField(surveyed, p)
    xy_m = np.array([[20.0, 9.0], [90.0, 9.0], [20.0, 9.0]])
    mean_ut, variance_ut2 = field.at(xy_m, np.array([0, 0, 3]))
    np.testing.assert_allclose(mean_ut[1:], np.tile(field.mean_ut, (2, 1)))
    np.testing.assert_allclose(variance_ut2[1:], np.tile(np.square(p.sigma_ut), (2, 1)))
    assert (variance_ut2[0] < 0.7 * variance_ut2[1]).all()


def test_a_walk_that_contradicts_all_others_is_believed_less(rng: np.random.Generator) -> None:
    """One walk along a row that others cross has another field: the map keeps that of the others better without it."""
    surveyed, xy_m = survey(rng, 0.0), np.column_stack([np.arange(4.0, 36.0), np.full(32, 9.0)])
    strange = surveyed.field_ut.copy()
    is_strange = surveyed.walk == ROWS_M.index(9.0)
    strange[is_strange] *= np.where(np.arange(is_strange.sum()) % 20 < 10, 2.0, 0.3)[:, None]
    mean_ut, variance_ut2 = MagneticField(replace(surveyed, field_ut=strange), MagneticFieldParams()).at(
        xy_m, np.zeros(32, int)
    )
    plain_ut2 = MagneticField(surveyed, MagneticFieldParams()).at(xy_m, np.zeros(32, int))[1]
    assert np.abs(mean_ut - true_ut(xy_m)).mean() < 0.5 * np.abs(0.7 * true_ut(xy_m)).mean()
    assert variance_ut2.mean() > 1.2 * plain_ut2.mean()


def test_turning_the_phone_changes_no_magnitude() -> None:
    field_ut = np.array([[3.0, 4.0, -7.0], [-4.0, 3.0, -7.0]])
    value_ut, toward = magnitudes_of(field_ut)
    np.testing.assert_allclose(value_ut, [[5.0, -7.0], [5.0, -7.0]])
    np.testing.assert_allclose(toward, [[0.6, 0.8], [-0.8, 0.6]])


def test_the_belief_is_that_of_linear_regression_where_tails_are_normal(rng: np.random.Generator) -> None:
    """Posterior of b in y = u . b + e with prior variance s^2: (U'U / r + 1 / s^2)^-1 U'y / r."""
    belief = OffsetBelief.prior(1, 7.0)
    toward = rng.standard_normal((6, 2))
    left, down = rng.standard_normal(6), rng.standard_normal(6)
    for k in range(6):
        belief.observe_horizontal(left[k : k + 1], np.array([4.0]), toward[k], 1e12)
        belief.observe_vertical(down[k : k + 1], np.array([4.0]), 1e12)
    precision = toward.T @ toward / 4.0 + np.eye(2) / 49.0
    np.testing.assert_allclose(belief.horizontal_ut[0], np.linalg.solve(precision, toward.T @ left / 4.0))
    np.testing.assert_allclose(belief.covariance_ut2[0], np.linalg.inv(precision))
    np.testing.assert_allclose(belief.vertical_ut, (down.sum() / 4.0) / (6 / 4.0 + 1 / 49.0))


def test_a_sample_that_cannot_be_moves_the_belief_little() -> None:
    """Of a t with 4 degrees of freedom the pull falls with the distance; of a normal it grows."""
    pulls = []
    for left_ut in (10.0, 1000.0):
        belief = OffsetBelief.prior(1, 7.0)
        belief.observe_vertical(np.array([left_ut]), np.array([9.0]), 4.0)
        pulls.append(float(belief.vertical_ut[0]))
    assert 0.0 < pulls[1] < pulls[0]


def rows_of(xy_m: FloatArray, t_s: FloatArray) -> dict[str, FloatArray]:
    """Of a phone that lies level with its top edge to the north, where the field points."""
    field_ut = measured_ut(xy_m, np.zeros(len(xy_m)), OFFSET_UT)
    attitude = np.tile([1.0, 0.0, 0.0, 0.0], (len(t_s), 1))
    return {"mag": np.column_stack([t_s, field_ut]), "rotation": np.column_stack([t_s, attitude])}


def walk_through(cloud: MagneticCloud, evidence: MagneticEvidence, *, weighs: bool = True) -> FloatArray:
    """A minute of 1 m/s: along y = 6, up and back along y = 12; where it ends."""
    corners = np.array([[4.0, 6.0], [30.0, 6.0], [30.0, 12.0], [10.0, 12.0]])
    apart = np.r_[0.0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T))]
    t_s = np.arange(0.0, apart[-1], 0.02)
    xy_m = np.column_stack([np.interp(t_s, apart, axis) for axis in corners.T])
    for second in range(int(apart[-1])):
        within = slice(50 * second, 50 * second + 51)
        evidence.update(rows_of(xy_m[within][1:], t_s[within][1:]))
        move_m = xy_m[within][-1] - xy_m[50 * second]
        cloud.move(move_m, 0.1**2 * np.eye(2))
        sample = evidence.after(float(np.hypot(*move_m)), float(t_s[within][-1]))
        if weighs and sample is not None:
            cloud.weigh_by_field(sample)
    return np.asarray(xy_m[within][-1])


def made(rng: np.random.Generator) -> tuple[MagneticCloud, MagneticEvidence]:
    evidence = MagneticEvidence(survey(rng), MagneticEvidenceParams(horizontal_trust=0.5))
    params = LearnedMapFilterParams(num_particles=4000, bias_sigma_rad=0.05)
    return MagneticCloud(HALL, np.random.default_rng(3), params, 0, None, evidence), evidence


def test_a_walker_whose_start_is_not_known_is_found_and_so_is_the_offset(rng: np.random.Generator) -> None:
    cloud, evidence = made(rng)
    cloud.begin_over_survey()
    assert cloud.sigma_m > 5.0
    end_m = walk_through(cloud, evidence)
    assert np.hypot(*(cloud.xy_m - end_m)) < 2.0 and cloud.sigma_m < 2.5
    assert abs(float(cloud.belief.vertical_ut.mean()) - OFFSET_UT[2]) < 2.5
    assert np.array_equal(cloud.belief.horizontal_ut.shape, (4000, 2))


def test_the_right_map_is_likelier_than_one_of_another_place(rng: np.random.Generator) -> None:
    evidences = []
    for shift_m in (0.0, 11.0):
        surveyed = survey(np.random.default_rng(1))
        shifted = (surveyed.xy_m + np.array([shift_m, 0.0])) % [40.0, 20.0]
        evidence = MagneticEvidence(replace(surveyed, xy_m=shifted), MagneticEvidenceParams())
        cloud = MagneticCloud(HALL, np.random.default_rng(3), LearnedMapFilterParams(), 0, None, evidence)
        cloud.begin_near(np.array([4.0, 6.0]))
        walk_through(cloud, evidence)
        evidences.append(cloud.log_evidence)
    assert evidences[0] > evidences[1] + 3.0


def test_one_who_stands_is_weighed_once(rng: np.random.Generator) -> None:
    _, evidence = made(rng)
    xy_m, t_s = np.tile([4.0, 6.0], (100, 1)), np.arange(100) / 50.0
    evidence.update(rows_of(xy_m, t_s))
    assert evidence.after(0.0, 1.0) is not None
    assert evidence.after(0.0, 1.5) is None and evidence.after(0.6, 1.5) is None
    assert evidence.after(0.6, 1.5) is not None
    evidence.begin()
    assert evidence.after(1.0, 1.0) is None  # nothing measured on this walk


@pytest.mark.parametrize("make", [Magnetic, MagneticFusion])
def test_what_lacks_a_survey_or_a_magnetometer_is_declined(make: type, rng: np.random.Generator) -> None:
    pytest.importorskip("torch")
    specs = {name: sensor_spec(name) for name in ("accel", "gyro", "rotation", "mag")}
    with pytest.raises(UnsuitableError, match="magnetic map"):
        make().reset(Briefing(HALL, specs, 0.2), rng)
    without = {name: spec for name, spec in specs.items() if name != "mag"}
    with pytest.raises(UnsuitableError, match="'mag'"):
        make().reset(Briefing(HALL, without, 0.2, magnetic_map=survey(rng)), rng)
