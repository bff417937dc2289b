"""A localizer on arrays of one's own answers as in an environment with the same walk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import pdrbench
from pdrbench.errors import RecordingError
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_sim.foot.known_walk import walk

SHOE = walk(num_strides=12, length_m=1.4, turn_rad=0.1)
ARRAYS = {"accel": (SHOE.t_s, SHOE.accel), "gyro": (SHOE.t_s, SHOE.gyro)}


class Seen:
    """Remembers its briefing and how many rows came."""

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self.briefing, self.rows, self.draw = briefing, 0, rng.random()

    def step(self, observation: Observation) -> Estimate:
        self.rows += len(observation["accel"])
        return Estimate(np.array([1.0, 2.0]), 3, heading_rad=0.5, sigma_m=0.25)


def test_a_foot_is_followed_on_the_clock_of_the_arrays() -> None:
    later = {name: (t_s + 1000.0, values) for name, (t_s, values) in ARRAYS.items()}
    found = pdrbench.replay(later, "foot_ins_robust", mounting="foot")
    assert (found.declined, found.failure) == ("", "")
    assert found.trajectory[0, 0] == 1000.0 and found.trajectory[-1, 0] == pytest.approx(1000.0 + SHOE.t_s[-1], abs=0.2)
    length_m = np.hypot(*SHOE.position_m[-1, :2])
    assert np.hypot(*found.trajectory[-1, 1:3]) == pytest.approx(length_m, rel=0.01)
    assert 0 < found.sigma_m[-1] < 0.5


def test_every_form_of_the_same_arrays_gives_the_same_bytes() -> None:
    rows = {name: np.column_stack(pair) for name, pair in ARRAYS.items()}
    frames = {
        name: pd.DataFrame(table, columns=["t_s", *(f"{axis}_{unit}" for axis in "xyz")])
        for (name, table), unit in zip(rows.items(), ("mps2", "radps"), strict=True)
    }
    mixed = {name: frame[frame.columns[::-1]] for name, frame in frames.items()}
    plain = pdrbench.replay(ARRAYS, "foot_ins", mounting="foot", start=(3, 4, 1), heading_rad=1.5)
    assert plain.trajectory[0].tolist() == [0.0, 3.0, 4.0, 1.0]
    for arrays in (rows, frames, mixed):
        again = pdrbench.replay(arrays, "foot_ins", mounting="foot", start=(3, 4, 1), heading_rad=1.5)
        assert again.trajectory.tobytes() == plain.trajectory.tobytes()


def test_a_recording_is_answered_as_in_its_environment() -> None:
    task = pdrbench.make_task("CampusPhone-v1")
    recording = task.load(task.split("train")[0])
    found = pdrbench.replay(recording, "dead_reckoning", start=task.tell_start(recording))
    result = pdrbench.evaluate(
        "dead_reckoning", "CampusPhone-v1", split="train", walks=[recording.id], isolation="none", seeds=1
    )
    np.testing.assert_allclose(found.trajectory[:, 1:3], result.results[0].estimates.xy_m, rtol=0, atol=0.5001e-4)


def test_an_object_is_briefed_and_given_every_row() -> None:
    seen = Seen()
    found = pdrbench.replay(ARRAYS, seen, mounting="pocket", subject={"height_m": 1.8}, seed=4)
    assert seen.rows == len(SHOE.t_s) and seen.draw == np.random.default_rng(4).random()
    assert seen.briefing.sensors["accel"].rate_hz == pytest.approx(200.0)
    assert (seen.briefing.mounting, dict(seen.briefing.subject)) == ("pocket", {"height_m": 1.8})
    assert seen.briefing.start is not None and seen.briefing.start.heading_rad == 0.0
    assert "rotation" in seen.briefing.sensors  # computed
    assert found.trajectory[5, 1:].tolist() == [1.0, 2.0, 3.0]
    assert (found.sigma_m[5], found.heading_rad[5]) == (0.25, 0.5)


def test_why_a_localizer_declines_or_fails_is_said(office: pdrbench.Building) -> None:
    declined = pdrbench.replay(ARRAYS, "wifi_knn")
    assert "needs the sensor 'wifi'" in declined.declined and not len(declined.trajectory)
    assert "mounting foot" in pdrbench.replay(ARRAYS, "foot_ins").declined
    assert "needs a known start" in pdrbench.replay(ARRAYS, "dead_reckoning", building=office).declined
    seen = Seen()
    seen.step = lambda observation: 1 / 0  # type: ignore[method-assign, assignment, return-value]
    assert "ZeroDivisionError" in pdrbench.replay(ARRAYS, seen).failure


PLACES_M = np.array([[x_m, y_m] for x_m in range(0, 40, 4) for y_m in (0.0, 8.0, 16.0)])
SENDERS_M = np.array([[0.0, 0.0], [39.0, 0.0], [0.0, 16.0], [39.0, 16.0]])
ASKED_M = np.array([[4.0, 16.0], [36.0, 0.0], [20.0, 16.0], [12.0, 0.0], [24.0, 8.0]])


def received_dbm(xy_m: np.ndarray) -> np.ndarray:
    """(n, 4) by path loss; 100 where it is too weak."""
    dbm = -40 - 25 * np.log10(np.hypot(*(xy_m[:, None] - SENDERS_M).transpose(2, 0, 1)) + 1)
    return np.where(dbm < -76, 100, dbm)


@pytest.mark.parametrize("localizer", ["wifi_knn?neighbours=1", "wlan_frank2009?unknown=penalise"])
def test_scans_are_placed_in_a_radio_map_of_ones_own(localizer: str, tmp_path: Path) -> None:
    """Each scan of a surveyed place is found there, whatever the table comes as; a column is known by its name."""
    survey = pd.DataFrame(received_dbm(PLACES_M), columns=list("abcd")).assign(
        x_m=PLACES_M[:, 0], y_m=PLACES_M[:, 1], level=2
    )
    scans = pd.DataFrame(received_dbm(ASKED_M), columns=list("abcd"))
    survey.to_csv(tmp_path / "survey.csv", index=False)
    survey_of_arrays = np.c_[PLACES_M, np.full(len(PLACES_M), 2)], received_dbm(PLACES_M)
    for radio_map, wifi in (
        (survey, scans.replace(100, np.nan)[list("dbca")]),
        (tmp_path / "survey.csv", scans),
        (survey_of_arrays, received_dbm(ASKED_M)),
        (survey, scans.assign(t_s=2.0 * np.arange(len(scans)))),
    ):
        found = pdrbench.replay({"wifi": wifi}, localizer, radio_map=radio_map)
        assert (found.declined, found.failure) == ("", "")
        rows = found.trajectory if len(found.trajectory) == len(scans) else found.trajectory[::10]
        np.testing.assert_allclose(rows[:, 1:], np.c_[ASKED_M, np.full(len(scans), 2)], atol=1e-6)


def test_tables_that_are_no_fingerprints_are_refused() -> None:
    table = pd.DataFrame({"x_m": [0.0], "y_m": [0.0], "a": [-50.0], "FLOOR": [3.0]})
    with pytest.raises(RecordingError, match="'FLOOR' is no RSSI in dBm"):
        pdrbench.replay({"wifi": table[["a"]]}, "wifi_knn", radio_map=table)
    with pytest.raises(RecordingError, match="no column 'x_m'"):
        pdrbench.replay({"wifi": table[["a"]]}, "wifi_knn", radio_map=table[["a"]])
    with pytest.raises(RecordingError, match="places are"):
        pdrbench.replay({"wifi": np.zeros((1, 2))}, "wifi_knn", radio_map=(np.zeros((2, 2)), np.zeros((3, 2))))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"accel": (SHOE.t_s * 1e3, SHOE.accel)}, "looks like milliseconds"),
        ({"accel": (SHOE.t_s, SHOE.accel / 9.80665)}, "looks like g"),
        ({"accel": (SHOE.t_s[:5], SHOE.accel)}, "times and values go together"),
        ({"accel": SHOE.accel}, r"shape \(\d+, 3\), expected \(n, 4\): t_s, x_mps2, y_mps2, z_mps2"),
        ({"accel": (SHOE.t_s, SHOE.accel), "gyro": (SHOE.t_s, np.degrees(SHOE.gyro))}, "degree/s"),
    ],
)
def test_arrays_that_cannot_be_meant_are_refused(arrays: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        pdrbench.replay(arrays, "step_count-v0")
