"""koeping2012_heading: behaviour and bad observations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.errors import PdrbenchError
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.sensors import sensor_spec
from pdrbench_lab.papers.koeping2012.heading import Koeping2012Heading, KoepingHeadingParams
from pdrbench_sim.buildings.assembly import Cell, Opening, assemble, rectangle


@pytest.fixture(scope="module")
def rooms() -> Building:
    """Two rooms of 8 m x 6 m with a door between, and a third, unconnected one."""
    cells = [
        Cell("a", rectangle(0, 0, 8, 6), 0.0, 0),
        Cell("b", rectangle(8, 0, 16, 6), 0.0, 0),
        Cell("apart", rectangle(20, 0, 26, 6), 0.0, 0),
    ]
    return Building("rooms", assemble(cells, [Opening("a", "b", (8.0, 2.0), (8.0, 3.0))]))


def begun(building: Building, **options: Any) -> Koeping2012Heading:
    localizer = Koeping2012Heading(KoepingHeadingParams(**options))
    spec = sensor_spec("position")
    localizer.reset(Briefing(building, {spec.name: spec}, 1.0), np.random.default_rng(0))
    return localizer


def see(localizer: Koeping2012Heading, now_s: float, *rows: tuple[float, float, float]) -> Estimate:
    return localizer.step(Observation(now_s, {"position": np.array(rows).reshape(-1, 3)}))


def test_follows_a_walker_from_an_unknown_start_on_the_floor(rooms: Building) -> None:
    """At 1.3 m/s from (2, 2.5) through the door to (14, 2.5)."""
    localizer, errors_m = begun(rooms, num_particles=300), []
    for k in range(10):
        true_m = np.array([2 + 1.3 * k, 2.5])
        errors_m.append(float(np.hypot(*(see(localizer, float(k), (float(k), *true_m)).xy_m - true_m))))
    assert max(errors_m) < 0.8 and np.mean(errors_m[1:]) < 0.4
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


def test_odd_rows_are_passed_over_and_after_a_gap_the_last_one_decides(rooms: Building) -> None:
    clean, dirty = begun(rooms), begun(rooms)
    nan = float("nan")
    for k in range(6):
        row = (float(k), 3.0 + k, 2.5)
        junk = [(float(k), 9.0, 5.0), (k - 1.0, 1.0, 1.0), (nan, 3.0, 3.0), (k + 0.1, nan, 3.0)]
        assert np.array_equal(see(clean, float(k), row).xy_m, see(dirty, float(k), row, *junk).xy_m)
    found = see(clean, 14.0, (13.0, 11.0, 3.0), (14.0, 12.3, 3.0))
    assert found.xy_m == pytest.approx([12.3, 3.0], abs=1.5)


def test_headings_learn_an_offset_from_walls() -> None:
    """A corridor of 2 m: the offset across it cannot stay."""
    localizer = begun(Building("corridor", assemble([Cell("c", rectangle(0, 0, 80, 2), 0.0, 0)], [])), sigma0_m=1.0)
    rng, offset_m = np.random.default_rng(3), np.array([0.0, 0.0])
    errors_m = []
    for k in range(50):
        true_m = np.array([5 + 1.3 * k, 1.0])
        offset_m = offset_m + [0.0, 0.06] + 0.1 * rng.standard_normal(2)  # 3 m to the side in the end
        found = see(localizer, float(k), (float(k), *(true_m + offset_m)))
        errors_m.append(abs(found.xy_m[1] - 1.0))
    assert abs(offset_m[1]) > 2.0 and max(errors_m) < 0.7
    assert found.heading_rad is not None and abs(found.heading_rad) < 0.3
    assert localizer.debug()["deaths"] == 0


@pytest.mark.parametrize("wrong", [{"q_m2ps": 0.0}, {"keeps_fraction": 1.0}, {"anew_mps": -1.0}])
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(PdrbenchError):
        KoepingHeadingParams(**wrong)
