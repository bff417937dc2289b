"""The replica of Frank et al. 2009: a university level with a rectangular hallway (claims F1 to F3, F13).

The hallway is a loop of 104 m between rooms; eleven access points hang all over the level. Calibration points lie every
2.5 m along the middle of the hallway: a person stood there for 60 scans, a laptop in the hands. 17 marks a lap lie on
the floor, without regard to the calibration points. A walker with a unit on the foot and the same laptop passes them in
four laps.

The paper shows its plan without a scale that could be read; sizes are ours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench.radio import survey_of_table
from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_lab.papers.ring_floor import RingFloor, corridor_polygon, make_ring
from pdrbench_lab.papers.single_scans import receive, wifi_rows
from pdrbench_sim.fields.magnetic import FOOT_M, MagneticParams, Sheet
from pdrbench_sim.noise import autoregressive
from pdrbench_sim.people.person import PersonParams, draw_person
from pdrbench_sim.people.route import Place
from pdrbench_sim.people.walker import NATURAL_WALK
from pdrbench_sim.radio.scans import PhonePath
from pdrbench_sim.radio.wlan import PropagationParams, RadioField, make_radio_field
from pdrbench_sim.record import ON_FOOT, BuildingScene, simulate_walk
from pdrbench_sim.resolution import rounded_reference, rounded_stream, rounded_survey

LAPS: Final = 4  # F1
NUM_MARKS: Final = 17  # F1
NUM_ACCESS_POINTS: Final = 11  # F3
SPACING_M: Final = 2.5  # F3, of calibration points
SCANS_A_POINT: Final = 60  # F3
SCAN_S: Final = 1.0  # between scans, at a calibration point and on the way
MOTION_M: Final = 0.2  # "slight motion" of the laptop at a point: standard deviation per axis; ours: decimetres
MOTION_S: Final = 5.0  # its correlation time; ours
DOOR_OPEN_FRACTION: Final = 0.6  # drawn anew for each point, once for a walk; ours, as for phones that walk
LONG_M: Final = 36.0  # of the middle lines of the hallway; ours
SHORT_M: Final = 16.0  # likewise
HALLWAY: Final = RingFloor(LONG_M, SHORT_M, width_m=2.4, room_depth_m=5.0, door_m=0.9)  # ours
LAP_M: Final = HALLWAY.lap_m
FIRST_MARK_M: Final = 1.5  # along the lap, from a corner: no mark lies in one; ours
COINCIDES_M: Final = 1.0  # so near to a calibration point a mark lies on it: fitted to F2's 20 % of errors below 0.5 m
LEAD_M: Final = 3.0  # walked before the first mark and after the last one; ours
BODY_HZ: Final = 10.0  # of the way of the body
MAX_DURATION_S: Final = 3600.0  # longer than any walk

# Fitted to what the paper reports of WLAN alone: a mean error of 3.18 m, 20 % of errors below 0.5 m, 15 to 25 % above
# 4 m (F1, F2), with the walkers of the train and val walks in their radio fields and 24 further ones. The error of the
# fused filter was seen beside it and is no part of what was minimised. A scan then gets five of eleven access points.
HALLWAY_WLAN: Final = PropagationParams(
    rssi_1m_dbm=-45.0,  # fitted: 25 dB below the law's 100 mW, which stand for weak senders and a deaf card
    rssi_1m_sigma_db=3.0,  # fitted
    exponent=2.5,  # fitted
    shadow_sigma_db=3.5,  # fitted
    shadow_length_m=7.0,  # fitted
    fading_sigma_db=3.9,  # fitted
    fading_correlation_1s=0.67,  # fitted
    receiver_height_m=1.2,  # F3
)
HALLWAY_WALK: Final = replace(  # marks "were followed then precisely", without a stop
    NATURAL_WALK,
    stop_fraction=0.0,
    u_turn_fraction=0.0,
    pause_every_s=1e6,
    sway_sigma_m=0.08,  # ours
    keep_right_m=(0.0, 0.0),
)
HALLWAY_PEOPLE: Final = PersonParams(  # ours: slow enough for the rests of F6, see `frank2009.experiments.pace`
    cadence_hz=(1.65, 0.08), step_factor=(0.92, 0.05)
)
CONCRETE: Final = MagneticParams(  # a floor without steel panels; W19 is about raised floors
    panels=Sheet(
        sigma_ut=6.0, at_m=FOOT_M, depth_m=0.1, order=3, num_waves=48
    )  # ours: turns headings by some 10 degrees
)
ON_FOOT_WITH_FIELD: Final = replace(ON_FOOT, sensors=("accel", "gyro", "mag"))


def make_hallway() -> Building:
    """The building: always the same one."""
    return make_ring(HALLWAY, "hallway")


def marks_xy_m() -> FloatArray:
    """(17, 2) marks on the floor, counter-clockwise."""
    return HALLWAY.xy_m(_marks_m())


def calibration_points_m() -> FloatArray:
    """(P,) calibration points along the lap, which is divided evenly, as near to `SPACING_M` as it goes."""
    count = round(LAP_M / SPACING_M)
    return np.arange(count, dtype=np.float64) * (LAP_M / count)


def _marks_m() -> FloatArray:
    """(17,) marks along the lap: evenly, and those near a calibration point on it."""
    even_m = FIRST_MARK_M + np.arange(NUM_MARKS) * (LAP_M / NUM_MARKS)
    points_m = calibration_points_m()
    nearest_m = points_m[np.abs(even_m[:, None] - points_m).argmin(axis=1)]
    return np.asarray(np.where(np.abs(nearest_m - even_m) <= COINCIDES_M, nearest_m, even_m), dtype=np.float64)


def make_hallway_radio(
    rng: np.random.Generator, building: Building, params: PropagationParams = HALLWAY_WLAN
) -> RadioField:
    """Eleven access points of 2.4 GHz and one identifier each, spread over the level, another field each time."""
    return make_radio_field(rng, building, num_access_points=NUM_ACCESS_POINTS, params=params)


def survey_hallway(rng: np.random.Generator, radio: RadioField, motion_m: float = MOTION_M) -> RadioMap:
    """Stands at every calibration point, facing one way along the hallway or the other (F3).

    Args:
        rng: Draws motion, doors and what is received.
        radio: Access points and their propagation.
        motion_m: Of the laptop, standard deviation per axis.

    Returns:
        Scans point by point, at the place that was clicked on the plan; `walk` is the point.
    """
    for_way, for_motion, for_doors, for_air = rng.spawn(4)
    s_m = calibration_points_m()
    point = np.repeat(np.arange(len(s_m)), SCANS_A_POINT)
    facing_rad = HALLWAY.heading_rad(s_m) + np.where(for_way.random(len(s_m)) < 0.5, math.pi, 0.0)
    is_open = for_doors.random((len(s_m), radio.num_doors)) < DOOR_OPEN_FRACTION
    xy_m = HALLWAY.xy_m(s_m)
    pause_s = 60.0  # between points: the air is another one
    t_s = np.arange(len(point)) * SCAN_S + point * pause_s
    held_m = xy_m[point] + motion_m * _slight_motion(for_motion, len(s_m))
    received_dbm = receive(
        radio,
        for_air,
        t_s,
        corridor_polygon(radio.building, len(point)),
        held_m,
        facing_rad[point],
        doors_open=is_open[point],
    )
    return rounded_survey(survey_of_table(xy_m[point], 0, point, received_dbm, radio.access_points.id))


def _slight_motion(rng: np.random.Generator, num_points: int) -> FloatArray:
    """(points * scans, 2) first-order autoregressive around each point, of unit variance."""
    noise = rng.standard_normal((num_points, SCANS_A_POINT, 2)).swapaxes(0, 1)
    motion = autoregressive(noise, math.exp(-SCAN_S / MOTION_S))
    return motion.swapaxes(0, 1).reshape(-1, 2)


def way_of_laps(building: Building, *, is_clockwise: bool) -> list[Place]:
    """Places to walk past: the start, the corners of four laps, the end."""
    marks_m, polygon = _marks_m(), int(corridor_polygon(building, 1)[0])
    length_m = 2 * LEAD_M + (LAPS - 1) * LAP_M + float(np.ptp(marks_m))
    first_m = float(marks_m[-1 if is_clockwise else 0])
    way_xy_m = HALLWAY.way_xy_m(first_m, length_m, is_clockwise=is_clockwise, lead_m=LEAD_M)
    return [Place(polygon, xy) for xy in way_xy_m]


def passages_of_marks(way: PhonePath, *, is_clockwise: bool) -> tuple[FloatArray, FloatArray]:
    """When a walker passed which marks.

    Returns:
        t_s: (68,) when the body was beside a mark, rising.
        xy_m: (68, 2) the marks.
    """
    turn = -1.0 if is_clockwise else 1.0
    along_m = np.maximum.accumulate(np.unwrap(turn * HALLWAY.along_m(way.xy_m), period=LAP_M))
    marks_m = np.concatenate([turn * _marks_m() + lap * LAP_M for lap in range(-1, LAPS + 2)])
    marks_m = np.sort(marks_m)
    begin = along_m[0] + LEAD_M / 2
    marks_m = marks_m[marks_m > begin][: LAPS * NUM_MARKS]
    rising = np.concatenate([[True], np.diff(along_m) > 0])
    return np.interp(marks_m, along_m[rising], way.t_s[rising]), HALLWAY.xy_m(turn * marks_m)


def body_way(building: Building, foot: Trajectory, end_s: float) -> PhonePath:
    """The way of the body, ten times a second: from rest to rest of one foot, over which it passes.

    Args:
        building: The hallway.
        foot: Where one foot rested and which way its bearer walked.
        end_s: Of the way.
    """
    assert foot.heading_rad is not None
    t_s = np.arange(math.floor(end_s * BODY_HZ) + 1) / BODY_HZ
    xy_m = np.column_stack([np.interp(t_s, foot.t_s, column) for column in foot.xy_m.T])
    heading_rad = np.interp(t_s, foot.t_s, np.unwrap(foot.heading_rad))
    return PhonePath(t_s, corridor_polygon(building, len(t_s)), xy_m, heading_rad)


def scan_hallway(rng: np.random.Generator, radio: RadioField, way: PhonePath) -> FloatArray:
    """(n, 5) rows of the `wifi` stream: a scan a second by the laptop that the walker carries, without stale rows."""
    for_doors, for_air = rng.spawn(2)
    row = slice(round(SCAN_S * BODY_HZ), None, round(SCAN_S * BODY_HZ))
    place = way.t_s[row], way.polygon[row], way.xy_m[row], way.heading_rad[row]
    is_open = for_doors.random(radio.num_doors) < DOOR_OPEN_FRACTION
    rssi_dbm = receive(radio, for_air, *place, doors_open=np.tile(is_open, (len(place[0]), 1)))
    return wifi_rows(radio, place[0], rssi_dbm)


def record_hallway(
    scene: BuildingScene,
    radio: RadioField,
    seed: Sequence[int],
    rng: np.random.Generator,
    *,
    people: PersonParams = HALLWAY_PEOPLE,
    name: str = "walk",
) -> Recording:
    """One walker's four laps, recorded; the building is not given (F14).

    Args:
        scene: The building and its magnetic field.
        radio: Its WLAN.
        seed: Numbers of the walker and the unit; the same ones give the same bytes.
        rng: Draws the person, the direction of the laps, doors and the air.
        people: Of whom the person is one.
        name: Id of the recording.

    Returns:
        Streams accel, gyro, mag and wifi; the reference has a row for each of the 68 passages of a mark.
    """
    for_way, for_person, for_scans = rng.spawn(3)
    person = draw_person(for_person, people)
    is_clockwise = bool(for_way.random() < 0.5)
    places = way_of_laps(scene.building, is_clockwise=is_clockwise)
    foot = simulate_walk(
        scene,
        seed,
        ON_FOOT_WITH_FIELD,
        duration_s=MAX_DURATION_S,
        person=person,
        places=places,
        walk=HALLWAY_WALK,
        name=name,
    )
    way = body_way(scene.building, foot.reference, foot.end_s)
    t_s, xy_m = passages_of_marks(way, is_clockwise=is_clockwise)
    reference = Trajectory(
        t_s=t_s, xy_m=xy_m, level=np.zeros(len(t_s), dtype=np.int64), surveyed=np.ones(len(t_s), dtype=np.bool_)
    )
    wifi = rounded_stream(SensorStream(sensor_spec("wifi"), scan_hallway(for_scans, radio, way)))
    return replace(foot, building=None, streams={**foot.streams, "wifi": wifi}, reference=rounded_reference(reference))
