"""The magnetic field of a building: physics, levels, magnetometers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import Building, FloorRegion
from pdrbench.errors import MapError, RecordingError
from pdrbench_sim.fields.dipoles import DipoleParams
from pdrbench_sim.fields.magnetic import (
    FOOT_M,
    HIP_M,
    MagneticField,
    MagneticParams,
    MagnetometerErrors,
    Sheet,
    draw_field,
    make_magnetic_field,
)

NO_DIPOLES = DipoleParams(per_m2=0.0)
PLAIN = MagneticParams(level_spread=0.0, dipoles=NO_DIPOLES)
SQUARE = FloorRegion(
    np.array([[[0.0, 0], [100, 0], [100, 100]], [[0.0, 0], [100, 100], [0, 100]]]), np.zeros(2, dtype=np.int64)
)


def drawn(seed: int, floor_m: list[float], params: MagneticParams | None = None) -> MagneticField:
    """A field over levels of 100 m by 100 m."""
    return draw_field(np.random.default_rng(seed), floor_m, [SQUARE] * len(floor_m), params)


def places(rng: np.random.Generator, count: int, height_m: float) -> np.ndarray:
    """(count, 3) anywhere in 100 m by 100 m."""
    return np.column_stack([rng.uniform(0, 100, (count, 2)), np.full(count, height_m)])


@pytest.mark.parametrize("height_m", [FOOT_M, HIP_M])
def test_field_has_neither_curl_nor_divergence(height_m: float):
    step_m = 2e-4
    for field in (drawn(seed, [0.0]) for seed in range(5)):
        at_m = places(np.random.default_rng(1), 40, height_m)
        columns = [(field.at(at_m + d) - field.at(at_m - d)) / (2 * step_m) for d in step_m * np.eye(3)]
        gradient = np.stack(columns, axis=2)  # (n, component, direction)
        # central differences are off by (k step)^2 / 6, 1e-5 for wavelengths of 0.1 m
        slack = 1e-4 * np.linalg.norm(gradient, axis=(1, 2)).max()
        assert np.abs(np.trace(gradient, axis1=1, axis2=2)).max() < slack
        assert np.abs(gradient - gradient.transpose(0, 2, 1)).max() < slack
        assert np.abs(gradient[:, 0, 1]).max() > 100 * slack


def test_without_a_building_there_is_the_earth_and_other_places_change_nothing():
    none = Sheet(sigma_ut=0.0, at_m=1.0, depth_m=1.0, order=2, num_waves=1)
    field = drawn(0, [0.0], MagneticParams(structure=none, panels=none, dipoles=NO_DIPOLES))
    np.testing.assert_array_equal(field.at([[3.0, 4.0, 1.0]]), [[0.0, 31.0, -30.0]])
    at_m = places(np.random.default_rng(6), 9001, 1.0)
    one, same = (drawn(7, [0.0, 3.5]) for _ in range(2))
    whole = one.at(at_m)
    np.testing.assert_array_equal(whole, same.at(at_m))
    np.testing.assert_array_equal(whole[4000:4003], one.at(at_m[4000:4003]))
    np.testing.assert_array_equal(whole, drawn(7, [0.0, 3.5, 7.0]).at(at_m))
    assert not np.array_equal(whole, drawn(8, [0.0, 3.5]).at(at_m))


def test_feet_decide_the_level_on_stairs():
    field = drawn(10, [0.0, 3.5])
    phone = np.array([[1.0, 2.0, 3.4], [1.0, 2.0, 3.6]])  # past the next floor while the feet are below it
    on_stairs, over_the_floor = field.at(phone, 2.3), field.at(phone)
    np.testing.assert_array_equal(on_stairs[0], over_the_floor[0])
    assert np.abs(np.diff(on_stairs, axis=0)).max() < 2
    assert np.abs(np.diff(over_the_floor, axis=0)).max() > 5  # the steel of the next floor, 0.1 m below
    np.testing.assert_array_equal(field.at(phone[1:], 3.5), over_the_floor[1:])


def test_a_building_has_a_field_everywhere(office: Building):
    field = make_magnetic_field(np.random.default_rng(12), office)
    again = make_magnetic_field(np.random.default_rng(12), office)
    assert len(field.floor_m) == len(office.levels) == 3
    assert field.floor_m[0] == 0
    polygon, xy_m = office.sample_uniform(np.random.default_rng(13), 500)
    treads = np.array([i for i, p in enumerate(office.polygons) if p.height_m not in field.floor_m])
    ground_m = np.concatenate([office.height(polygon), office.height(treads)])
    xy_m = np.concatenate([xy_m, [office.polygons[i].outline_xy_m.mean(axis=0) for i in treads]])
    at_m = np.column_stack([xy_m, ground_m + FOOT_M])
    field_ut = field.at(at_m, ground_m)
    assert len(treads)
    assert np.abs(field_ut).max() < 5000  # what a sensor can deliver
    plenty = MagneticParams(dipoles=DipoleParams(per_m2=0.1))
    crowded = make_magnetic_field(np.random.default_rng(12), office, plenty)
    for level, steel in zip(office.levels, crowded._levels, strict=True):
        area_m2 = sum(polygon.area_m2 for polygon in office.polygons if polygon.level == level)
        assert len(steel.dipoles.centre_m) == pytest.approx(0.1 * area_m2, rel=0.4)
        assert office.contains(steel.dipoles.centre_m[:, :2], np.full(len(steel.dipoles.centre_m), level)).all()
    np.testing.assert_array_equal(field_ut, again.at(at_m, ground_m))


@pytest.mark.parametrize("floor_m", [[], [0.0, 0.0], [3.0, 0.0], [np.nan], [[0.0]], 0.0])
def test_levels_that_are_none_are_refused(floor_m):
    with pytest.raises(MapError, match="heights of one level or more, increasing"):
        draw_field(np.random.default_rng(0), floor_m, [], None)


def test_places_that_are_none_are_refused():
    field = drawn(0, [0.0])
    with pytest.raises(MapError, match=r"place 1 at -0.2 m is below the floor at 0 m"):
        field.at([[0.0, 0.0, 1.0], [0.0, 0.0, -0.2]])
    with pytest.raises(MapError, match=r"below the floor at 0.5 m"):
        field.at([[0.0, 0.0, 0.4]], 0.5)
    for bad in ([0.0, 0.0, 1.0], [[0.0, 0.0]], [[0.0, 0.0, np.nan]]):
        with pytest.raises(MapError, match=r"finite \(n, 3\)"):
            field.at(bad)
    assert field.at(np.zeros((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("change", [{"sigma_ut": -1.0}, {"depth_m": 0.0}, {"order": -1}, {"num_waves": 0}])
def test_sheets_that_are_none_are_refused(change):
    with pytest.raises(MapError, match="a sheet of sources"):
        replace(PLAIN.panels, **change)


def test_a_perfect_magnetometer_turns_the_field_into_its_body():
    half = np.sqrt(0.5)
    perfect = MagnetometerErrors(noise_ut=0.0)
    turned_left = np.array([[half, 0, 0, half]])  # its x axis points along +y of the building
    measured = perfect.measure([[0.0, 31.0, -30.0]], turned_left, np.random.default_rng(0))
    np.testing.assert_allclose(measured, [[31.0, 0.0, -30.0]], atol=1e-12)


def test_turning_once_around_shows_the_hard_iron_and_the_soft_iron():
    angle_rad = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    turns = np.column_stack([np.cos(angle_rad / 2), np.zeros((360, 2)), np.sin(angle_rad / 2)])
    field_ut = np.tile([0.0, 31.0, 0.0], (360, 1))
    errors = MagnetometerErrors(np.array([40.0, -20.0, 5.0]), np.diag([1.05, 0.95, 1.0]), noise_ut=0.0)
    measured = errors.measure(field_ut, turns, np.random.default_rng(0))
    np.testing.assert_allclose(measured.mean(axis=0), [40.0, -20.0, 5.0], atol=1e-9)
    np.testing.assert_allclose(np.ptp(measured, axis=0), [2 * 31 * 1.05, 2 * 31 * 0.95, 0.0], atol=1e-9)


def test_noise_is_white_and_more_samples_do_not_change_it():
    errors = MagnetometerErrors(noise_ut=0.5)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (20_000, 1))
    measured = errors.measure(np.zeros((20_000, 3)), still, np.random.default_rng(1))
    np.testing.assert_allclose(measured.std(axis=0), 0.5, rtol=0.02)  # 0.5 % of standard error
    assert abs(np.mean(measured[1:] * measured[:-1])) < 0.25 * 0.02
    first = errors.measure(np.zeros((100, 3)), still[:100], np.random.default_rng(1))
    np.testing.assert_array_equal(first, measured[:100])


def test_magnetometers_that_are_none_are_refused():
    with pytest.raises(RecordingError, match="hard_iron_ut of a magnetometer"):
        MagnetometerErrors(hard_iron_ut=np.zeros(2))
    with pytest.raises(RecordingError, match="soft_iron of a magnetometer"):
        MagnetometerErrors(soft_iron=np.full((3, 3), np.nan))
    with pytest.raises(RecordingError, match="0 uT or more"):
        MagnetometerErrors(noise_ut=-1.0)
    with pytest.raises(RecordingError, match=r"\(n, 4\) attitudes"):
        MagnetometerErrors().measure(np.zeros((3, 3)), np.zeros((2, 4)), np.random.default_rng(0))
