from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.errors import MapError
from pdrbench.radio import divide
from pdrbench_baselines.woodman2008.visibility import VisibilityMap
from pdrbench_lab.papers.single_scans import receive, wifi_rows
from pdrbench_lab.papers.woodman2008.survey import survey
from pdrbench_sim.radio.wlan import RadioField, make_radio_field


@pytest.fixture(scope="module")
def field(office: Building) -> RadioField:
    return make_radio_field(np.random.default_rng(8), office, num_access_points=30)


def test_the_survey_has_enough_scans_in_every_cell(field: RadioField, office: Building):
    cells = divide(office)
    radio_map = survey(np.random.default_rng(2), field, cells)
    cell = cells.locate(radio_map.level, radio_map.xy_m)
    np.testing.assert_array_equal(cell, radio_map.walk)
    assert np.bincount(cell, minlength=cells.num_cells).min() >= 20
    assert radio_map.surveyed
    assert len(np.unique(radio_map.xy_m, axis=0)) == len(radio_map)
    assert VisibilityMap.from_radio_map(cells, radio_map).num_stray == 0
    with pytest.raises(MapError, match="2 queries"):
        survey(np.random.default_rng(2), field, cells, 1)


def test_every_start_is_in_the_region_of_its_scan(field: RadioField, office: Building):
    """W14: inside on 99 % of starts and more; of 400 as good ones, 9 outside is a chance of 1 in 100."""
    rng = np.random.default_rng(5)
    seen = VisibilityMap.from_radio_map(divide(office), survey(rng, field, divide(office)))
    polygon, xy_m = office.sample_uniform(rng, 400)
    doors = rng.random((400, field.num_doors)) < 0.5
    heading_rad, t_s = rng.uniform(-np.pi, np.pi, 400), 60.0 * np.arange(400)
    rows = wifi_rows(field, t_s, receive(field, rng, t_s, polygon, xy_m, heading_rad, doors_open=doors))
    scans = [rows[rows[:, 0] == t] for t in t_s]
    regions = [seen.start(scan[:, 1], scan[:, 2]).region for scan in scans]
    inside = [region.contains(polygon[i], xy_m[i])[0] for i, region in enumerate(regions)]
    assert sum(inside) >= 392
    # thin walls and a small building: about half of it is left
    assert np.median([region.area_m2 for region in regions]) < 0.6 * office.area_m2
