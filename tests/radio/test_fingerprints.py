from __future__ import annotations

import numpy as np

from pdrbench.radio import UNHEARD_DBM, FingerprintTable, strength
from pdrbench.recording import RadioMap


def make_map() -> RadioMap:
    return RadioMap(
        xy_m=[[0, 0], [10, 0], [10, 10]],
        level=[0, 0, 1],
        walk=[0, 0, 1],
        first=[0, 2, 5, 5],
        access_point=[30, 10, 10, 20, 20],
        rssi_dbm=[-40.0, -70.0, -50.0, -60.0, -55.0],
        age_s=[0.0, 9.0, 0.0, 1.0, 2.0],
    )


def test_the_table_holds_the_strongest_fresh_reading_by_access_point() -> None:
    table = FingerprintTable.from_radio_map(make_map(), max_age_s=5.0)
    u = UNHEARD_DBM
    assert table.access_point.tolist() == [10, 20, 30]
    assert table.rssi_dbm.tolist() == [[u, u, -40.0], [-50.0, -55.0, u], [u, u, u]]
    table = FingerprintTable.from_radio_map(make_map(), max_age_s=100.0)
    assert table.first.tolist() == [0, 2, 3, 4]
    assert table.column.tolist() == [0, 0, 1, 2]
    assert table.fingerprint.tolist() == [0, 1, 1, 0]  # rising within an access point
    assert table.reading_dbm.tolist() == [-70.0, -50.0, -55.0, -40.0]


def test_a_survey_without_fresh_readings_is_empty_and_strength_grows_from_zero() -> None:
    table = FingerprintTable.from_radio_map(make_map(), max_age_s=-1.0)
    assert table.rssi_dbm.shape == (3, 0)
    assert not len(table.access_point) and not len(table.reading_dbm)
    assert strength(np.array([UNHEARD_DBM, -120.0, -90.0]), 2.0).tolist() == [0.0, 0.0, 100.0]
