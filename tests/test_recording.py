from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.recording import MagneticMap, RadioMap, Recording, SensorSpec, SensorStream
from pdrbench.trajectory import Trajectory

SPEC = SensorSpec("accel", ("t_s", "x_mps2"), [0, -100], [1e6, 100], 50.0, "a test sensor")
EMPTY = Trajectory(np.zeros(0), np.zeros((0, 2)), np.zeros(0, int), np.zeros(0, bool))


def test_what_is_wrong_with_a_stream_is_named() -> None:
    with pytest.raises(RecordingError, match=r"'accel': t_s goes back at row 2 \(0.500 after 1.000\)"):
        SensorStream(SPEC, [[0, 1], [1, 1], [0.5, 1]])
    with pytest.raises(RecordingError, match=r"expected \(T, 2\)"):
        SensorStream(SPEC, np.zeros((4, 3)))
    with pytest.raises(RecordingError, match="no column 'y_mps2'; columns: t_s, x_mps2"):
        SensorStream(SPEC, np.zeros((1, 2))).column("y_mps2")
    with pytest.raises(RecordingError, match="filed under 'gyro'"):
        Recording("walk", None, {"gyro": SensorStream(SPEC, np.zeros((1, 2)))}, EMPTY)


@pytest.mark.parametrize("value", [np.nan, np.inf, 981.0])
def test_a_value_no_sensor_can_deliver_is_refused(value: float) -> None:
    with pytest.raises(RecordingError, match=r"x_mps2 is .* at row 1"):
        SensorStream(SPEC, [[0, 1], [1, value]])


@pytest.mark.parametrize(
    "fields",
    [
        {"columns": ("x_mps2", "t_s")},
        {"columns": ("t_s", "t_s")},
        {"low": [1, -100]},
        {"high": [np.inf, 100]},
        {"low": [0]},
    ],
)
def test_a_spec_that_no_observation_could_honour_is_refused(fields: dict[str, object]) -> None:
    good = {"name": "accel", "columns": SPEC.columns, "low": SPEC.low, "high": SPEC.high, "rate_hz": 1.0, "what": ""}
    with pytest.raises(RecordingError):
        SensorSpec(**(good | fields))  # type: ignore[arg-type]


def test_end_is_the_last_thing_recorded() -> None:
    reference = Trajectory([0.0, 7.0], np.zeros((2, 2)), [0, 0], [True, True])
    stream = SensorStream(SPEC, [[0, 0], [5, 0]])
    assert Recording("walk", None, {"accel": stream}, reference).end_s == 7.0
    assert Recording("walk", None, {"accel": stream}, EMPTY).end_s == 5.0


@pytest.mark.parametrize(
    "changes",
    [
        {"first": [0, 2]},
        {"first": [0, 2, 1]},
        {"first": [1, 1, 3]},
        {"rssi_dbm": [-50.0, -60.0]},
        {"xy_m": [[0, 0]]},
        {"age_s": [0, 0, np.nan]},
    ],
)
def test_a_radio_map_whose_parts_disagree_is_refused(changes: dict[str, object]) -> None:
    good = {
        "xy_m": [[0, 0], [1, 1]],
        "level": [0, 0],
        "walk": [0, 0],
        "first": [0, 1, 3],
        "access_point": [7, 7, 8],
        "rssi_dbm": [-50.0, -60.0, -70.0],
        "age_s": [0.0, 0.0, 0.0],
    }
    assert len(RadioMap(**good)) == 2  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match="radio map"):
        RadioMap(**(good | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "changes",
    [{"xy_m": [[0, 0]]}, {"walk": [0]}, {"field_ut": [[30, -30], [30, -30]]}, {"xy_m": [[0, 0], [0, np.nan]]}],
)
def test_a_magnetic_map_whose_parts_disagree_is_refused(changes: dict[str, object]) -> None:
    good = {"xy_m": [[0, 0], [1, 1]], "level": [0, 0], "walk": [0, 0], "field_ut": [[0, 30, -30], [1, 29, -31]]}
    made = MagneticMap(**good)  # type: ignore[arg-type]
    assert len(made) == 2 and not made.field_ut.flags.writeable
    with pytest.raises(RecordingError, match="magnetic map"):
        MagneticMap(**(good | changes))  # type: ignore[arg-type]
