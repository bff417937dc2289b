"""koeping2012: behaviour and bad observations."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.errors import MapError, PdrbenchError
from pdrbench.localizer import Briefing, Observation
from pdrbench.recording import SensorSpec
from pdrbench.sensors import sensor_spec
from pdrbench_baselines.koeping2012.localizer import Koeping2012, KoepingParams
from pdrbench_sim.buildings.assembly import Cell, Opening, assemble, rectangle

NOTHING = np.zeros((0, 3))


@pytest.fixture(scope="module")
def rooms() -> Building:
    """Two rooms of 8 m x 6 m with a door between, and a third, unconnected one."""
    cells = [
        Cell("a", rectangle(0, 0, 8, 6), 0.0, 0),
        Cell("b", rectangle(8, 0, 16, 6), 0.0, 0),
        Cell("apart", rectangle(20, 0, 26, 6), 0.0, 0),
    ]
    return Building("rooms", assemble(cells, [Opening("a", "b", (8.0, 2.0), (8.0, 3.0))]))


def brief(building: Building | None, spec: SensorSpec | None = None, period_s: float = 1.0) -> Briefing:
    spec = spec or sensor_spec("position")
    return Briefing(building, {spec.name: spec}, period_s)


def begun(building: Building, seed: int = 0, **options):
    localizer = Koeping2012(KoepingParams(**options))
    localizer.reset(brief(building), np.random.default_rng(seed))
    return localizer


def see(localizer, now_s: float, *rows: tuple[float, float, float]):
    return localizer.step(Observation(now_s, {"position": np.array(rows) if rows else NOTHING}))


def walk_along(localizer, noise_m: float = 0.0, seed: int = 0) -> np.ndarray:
    """Errors on a walk at 1.3 m/s from (2, 2.5) through the door to (14, 2.5)."""
    rng = np.random.default_rng(seed)
    errors = []
    for k in range(10):
        true_m = np.array([2 + 1.3 * k, 2.5])
        found = see(localizer, float(k), (float(k), *(true_m + noise_m * rng.standard_normal(2))))
        errors.append(float(np.hypot(*(found.xy_m - true_m))))
    return np.array(errors)


def test_follows_a_walker_from_an_unknown_start(rooms: Building) -> None:
    errors_m = walk_along(begun(rooms))
    assert errors_m.max() < 0.8
    assert errors_m[1:].mean() < 0.4


def test_particles_are_on_the_floor_and_as_many_as_asked_for(rooms: Building) -> None:
    localizer = begun(rooms, num_particles=300)
    walk_along(localizer, 0.3)
    state = localizer.debug()
    assert state["num_particles"] == 300
    assert (rooms.locate(state["particles_xy_m"], 0) == state["particles_polygon"]).all()
    assert state["particles_weight"].sum() == pytest.approx(1.0)


@pytest.mark.parametrize("where", [(1e5, -1e5), (23.0, 3.0), (-40.0, 3.0)])
def test_an_observation_far_from_particles_or_floor_is_answered_on_the_floor(rooms: Building, where) -> None:
    localizer = begun(rooms)
    for k in range(3):
        see(localizer, float(k), (float(k), 3.0, 3.0))
    for k in range(3, 8):
        found = see(localizer, float(k), (float(k), *where))
        assert np.isfinite(found.xy_m).all() and np.isfinite(found.sigma_m)
        assert rooms.contains(localizer.debug()["particles_xy_m"], 0).all()
    back = [see(localizer, float(k), (float(k), 12.0, 3.0)) for k in range(8, 40)][-1]
    assert np.isfinite(back.xy_m).all()


def test_particles_do_not_jump_to_a_part_that_nothing_connects(rooms: Building) -> None:
    """Documented outcome: particles in one part never reach another, whatever the sensor says."""
    localizer = begun(rooms)
    for k in range(4):
        see(localizer, float(k), (float(k), 2.0, 3.0))
    found = [see(localizer, float(k), (float(k), 23.0, 3.0)) for k in range(4, 30)][-1]
    assert 14.0 < found.xy_m[0] <= 16.0  # at the wall nearest to it
    fresh = begun(rooms)
    assert see(fresh, 0.0, (0.0, 23.0, 3.0)).xy_m == pytest.approx([23.0, 3.0], abs=0.4)


def test_missing_observations_move_particles_without_weighing(rooms: Building) -> None:
    localizer = begun(rooms)
    known = see(localizer, 0.0, (0.0, 4.0, 3.0))
    unknown = [see(localizer, float(k)) for k in range(1, 8)][-1]
    assert known.sigma_m < 0.5 < 1.0 < unknown.sigma_m
    assert see(localizer, 8.0, (8.0, 4.0, 3.0)).sigma_m < 0.8


def test_after_a_gap_or_several_rows_the_last_row_decides(rooms: Building) -> None:
    localizer = begun(rooms)
    see(localizer, 0.0, (0.0, 3.0, 3.0))
    found = see(localizer, 9.0, (8.0, 11.0, 3.0), (9.0, 12.3, 3.0))
    assert found.xy_m == pytest.approx([12.3, 3.0], abs=1.5)


def test_duplicate_late_and_broken_rows_are_passed_over(rooms: Building) -> None:
    clean, dirty = begun(rooms), begun(rooms)
    nan = float("nan")
    for k in range(6):
        row = (float(k), 3.0 + k, 2.5)
        junk = [(float(k), 9.0, 5.0), (k - 1.0, 1.0, 1.0), (nan, 3.0, 3.0), (k + 0.1, nan, 3.0)]
        assert np.array_equal(see(clean, float(k), row).xy_m, see(dirty, float(k), row, *junk).xy_m)


def test_the_table_is_made_for_the_rhythm_of_the_sensor(rooms: Building) -> None:
    slow = SensorSpec("position", ("t_s", "x_m", "y_m"), [0, -1e5, -1e5], [1e5, 1e5, 1e5], 0.5, "Every two seconds.")
    events = SensorSpec("position", ("t_s", "x_m", "y_m"), [0, -1e5, -1e5], [1e5, 1e5, 1e5], None, "Now and then.")
    for spec, period_s, update_s in ((slow, 1.0, 2.0), (events, 0.5, 0.5)):
        localizer = Koeping2012()
        localizer.reset(brief(rooms, spec, period_s), np.random.default_rng(0))
        assert localizer._table.params.update_s == update_s


def test_the_heaviest_cell_is_one_of_the_cells(rooms: Building) -> None:
    localizer = begun(rooms, estimate="map")
    found = [see(localizer, float(k), (float(k), 4.0, 3.0)) for k in range(3)][-1]
    assert np.allclose(np.mod(found.xy_m, 0.5), 0.25)
    assert found.xy_m == pytest.approx([4.0, 3.0], abs=0.8)


def test_settings_that_make_no_sense_are_refused() -> None:
    for wrong in ({"num_particles": 0}, {"sigma0_m": 0.0}, {"q_m2ps": -1.0}, {"estimate": "mode"}):
        with pytest.raises(PdrbenchError):
            KoepingParams(**wrong)  # type: ignore[arg-type]
    with pytest.raises(MapError, match="no floor"):
        Building("nothing", ())
