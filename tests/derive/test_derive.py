from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import UnknownNameError
from pdrbench.geometry import wrap_rad
from pdrbench.inertial import phone_heading_rad, to_world
from pdrbench.inertial.quaternions import about_vertical, inverse, multiply
from pdrbench.recording import SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.sensors.checks import Finding
from pdrbench.trajectory import Start
from pdrbench_formats.derive import attitude, derive, missing_reason
from pdrbench_formats.recordings.axes import moves_as_shoe
from pdrbench_formats.recordings.findings import examine
from pdrbench_sim.foot.known_walk import walk as foot_walk

RATE_HZ = 50.0
EARTH_UT = np.array([0.0, 31.0, -30.0])  # z up
START = Start(np.array([3.0, 4.0]), level=0, heading_rad=0.7)


class Walker:
    """A phone in the hand of somebody who walks with 1.8 steps a second and turns to and fro, up a stair at last."""

    def __init__(self, seconds: float = 60.0, drift_radps: float = 0.0) -> None:
        self.t_s = t_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
        self.heading_rad = 0.7 + 0.8 * np.sin(0.2 * t_s)
        tilt = np.array([np.cos(0.2), np.sin(0.2), 0.0, 0.0])
        self.quaternion = multiply(about_vertical(self.heading_rad - np.pi / 2), np.tile(tilt, (len(t_s), 1)))
        back = inverse(self.quaternion)
        up = 9.81 + 2.5 * np.sin(2 * np.pi * 1.8 * t_s)
        spin_radps = 0.16 * np.cos(0.2 * t_s)
        zeros = np.zeros(len(t_s))
        self.accel = np.column_stack([t_s, to_world(back, np.column_stack([zeros, zeros, up]))])
        self.gyro = np.column_stack([t_s, to_world(back, np.column_stack([zeros, zeros, spin_radps + drift_radps]))])
        self.mag = np.column_stack([t_s, to_world(back, np.broadcast_to(EARTH_UT, (len(t_s), 3)))])
        climbed_m = np.clip(0.3 * (t_s - seconds / 2), 0.0, 3.6)
        self.baro = np.column_stack([t_s, 1000.0 * np.exp(-climbed_m / 8435.0)])[::5]

    def streams(self, *names: str) -> dict[str, SensorStream]:
        return {name: SensorStream(sensor_spec(name), getattr(self, name)) for name in names}

    def error_deg(self, rotation: np.ndarray) -> np.ndarray:
        """(n,) of headings."""
        return np.degrees(np.abs(wrap_rad(phone_heading_rad(rotation[:, 1:]) - self.heading_rad[-len(rotation) :])))


def foot_streams(num_strides: int = 6, **quick: float) -> dict[str, SensorStream]:
    motion = foot_walk(num_strides, **quick)
    rows = {"accel": motion.accel, "gyro": motion.gyro}
    return {
        name: SensorStream(sensor_spec(name), np.column_stack([motion.t_s, values])) for name, values in rows.items()
    }


def test_the_yaw_begins_at_a_given_heading_or_where_the_magnetometer_has_north() -> None:
    walker = Walker()
    assert walker.error_deg(attitude(walker.accel, walker.gyro, None, 0.7)).max() < 1.0
    walker = Walker()
    assert walker.error_deg(attitude(walker.accel, walker.gyro, walker.mag)).max() < 2.0


def test_a_steady_field_stops_the_drift_of_a_gyroscope_and_a_bent_one_does_not_turn_it() -> None:
    drifting = Walker(240.0, drift_radps=np.radians(0.1))
    alone = drifting.error_deg(attitude(drifting.accel, drifting.gyro, None, 0.7))
    held = drifting.error_deg(attitude(drifting.accel, drifting.gyro, drifting.mag, 0.7))
    assert alone[-1] > 20.0 > 9.0 > held[-1]
    sound, bent = Walker(240.0), Walker(240.0)
    # Steel: every few metres other by 10 of 43 microtesla, and 40 degrees wrong in the mean.
    steel_ut = to_world(inverse(bent.quaternion), np.array([25.0, 0.0, 5.0]))
    bent.mag[:, 1:] += (1.0 + np.sin(1.3 * bent.t_s))[:, None] * steel_ut
    assert sound.error_deg(attitude(bent.accel, bent.gyro, bent.mag, 0.7)).max() < 1.0


def test_a_bias_shown_at_rest_is_taken_off() -> None:
    t_s = np.arange(3000) / RATE_HZ
    accel = np.column_stack([t_s, 0 * t_s, 0 * t_s, 0 * t_s + 9.81])
    gyro = np.column_stack([t_s, 0 * t_s, 0 * t_s, 0 * t_s + 0.02])
    rotation = attitude(accel, gyro, None, 0.0)
    assert abs(float(phone_heading_rad(rotation[-1, 1:]))) < 0.03  # of 1.2


@pytest.mark.parametrize(
    ("mounting", "wanted"),
    [("hand", ("rotation",)), ("hand", ("position",)), ("hand", ("level_change",)), ("foot", ("stride", "position"))],
)
def test_no_row_knows_what_comes_later(mounting: str, wanted: tuple[str, ...]) -> None:
    streams = foot_streams() if mounting == "foot" else Walker().streams("accel", "gyro", "mag", "baro")
    cut_s = 0.7 * float(streams["accel"].t_s[-1])
    begun = {name: SensorStream(s.spec, s.rows[s.t_s <= cut_s]) for name, s in streams.items()}
    whole, part = (derive(given, mounting, wanted, start=START) for given in (streams, begun))
    for name in wanted:
        assert len(part[name].rows)
        assert part[name].rows == pytest.approx(whole[name].rows[whole[name].t_s <= cut_s], abs=0)
        assert part[name].spec.derived


def test_what_is_recorded_stays_and_what_is_not_wanted_is_not_added() -> None:
    streams = Walker(10.0).streams("accel", "gyro", "baro")
    derived = derive(streams, "hand", ["accel", "position", "wifi"], start=START)
    assert list(derived) == ["accel", "gyro", "baro", "position"]
    assert derived["accel"] is streams["accel"]
    assert not derived["accel"].spec.derived
    with pytest.raises(UnknownNameError, match="did you mean 'rotation'"):
        derive(streams, "hand", ["rotations"])


def test_positions_follow_the_phone() -> None:
    walker = Walker(60.0)
    position = derive(walker.streams("accel", "gyro"), "hand", ["position"], start=START)["position"]
    speed_mps = 1.8 * 0.63
    way_m = START.xy_m + np.cumsum(
        np.column_stack([np.cos(walker.heading_rad), np.sin(walker.heading_rad)]) * speed_mps / RATE_HZ, axis=0
    )
    apart_m = np.hypot(*(position.rows[:, 1:] - way_m[np.rint(position.t_s * RATE_HZ).astype(int) - 1]).T)
    assert apart_m.max() < 2.0


def test_the_attitude_of_a_shoe_is_not_that_of_a_phone() -> None:
    phone, shoe = Walker(10.0).streams("accel", "gyro"), foot_streams(20, swing_s=0.5, tilt_rad=0.9)
    assert moves_as_shoe({name: stream.rows for name, stream in shoe.items()})
    assert not moves_as_shoe({name: stream.rows for name, stream in phone.items()})
    rows = {"accel": shoe["accel"].rows * [1, 1, -1, -1], "gyro": shoe["gyro"].rows * [1, 1, -1, -1]}
    sign = Finding("warning", "accel-sign", "accel", "z down", "turn it")
    assert not {"axes", "accel-sign"} & {finding.code for finding in examine(rows, [sign])}
    assert "axes" in {finding.code for finding in examine({**rows, "gyro": rows["gyro"][:, [0, 2, 3, 1]]})}
    assert list(derive(shoe, "", ["rotation", "position"], start=START)) == ["accel", "gyro"]
    assert "of gravity comes out upright" in missing_reason(shoe, "", "rotation", start=START)
    assert "rotation" in derive(phone, "", ["rotation"], start=START)


def test_strides_of_a_shoe_are_as_long_as_they_were() -> None:
    motion = foot_walk(6)
    strides = derive(foot_streams(), "foot", ["stride"])["stride"].column("length_m")
    assert strides.sum() == pytest.approx(float(np.hypot(*motion.position_m[-1, :2])), rel=0.05)


@pytest.mark.parametrize(
    ("mounting", "name", "reason"),
    [
        ("hand", "wifi", "'wifi' is measured or missing: nothing computes it from other sensors"),
        ("hand", "level_change", "'level_change' is computed from accel and baro; this recording has no baro"),
        ("pocket", "stride", "strides are computed for a unit on a foot; this one is carried in 'pocket'"),
        ("foot", "rotation", "the attitude of a phone is computed for phones; a unit on a foot gets strides"),
        ("foot", "stride", "'accel' comes at 50 Hz; 80 Hz or more are needed"),
        ("hand", "position", "a position is counted from a known start; none is given"),
        ("hand", "accel", ""),
    ],
)
def test_what_is_missing_is_said_in_one_line(mounting: str, name: str, reason: str) -> None:
    assert missing_reason(Walker(10.0).streams("accel", "gyro"), mounting, name) == reason


@pytest.mark.parametrize("rows", [1, 5, 40])
def test_little_is_no_error(rows: int) -> None:
    walker = Walker(10.0)
    streams = walker.streams("accel", "gyro", "mag", "baro")
    few = {name: SensorStream(s.spec, s.rows[:rows]) for name, s in streams.items()}
    late = few | {"accel": SensorStream(sensor_spec("accel"), walker.accel[-rows:])}  # after every rate
    for given in (few, late):
        wanted = ("rotation", "position", "level_change")
        derived = derive(given, "hand", wanted, start=START)
        assert {name for name in wanted if missing_reason(given, "hand", name, start=START)} == {
            name for name in wanted if name not in derived
        }
