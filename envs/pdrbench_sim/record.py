"""Whole walks with every sensor: `make_scene` is a building with its fields, `simulate_walk` sends a person through it.

A walk is generated in the order in which it comes about: the places to visit and the way between them, where the feet
rest, how the foot or the phone moves, what a perfect unit there would measure, what this unit makes of it. Radio,
magnetism and pressure are read along the way of the device. Each of these processes draws from a generator of its own,
named by what it is for: a sensor more, or fewer, changes no other stream.
"""

from __future__ import annotations

import functools
import math
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import PdrbenchError, unknown_name
from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench.inertial import to_world
from pdrbench.inertial.quaternions import from_yaw_pitch_roll
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_sim.fields import barometer
from pdrbench_sim.fields.magnetic import MagneticField, MagneticParams, draw_magnetometer, make_magnetic_field
from pdrbench_sim.foot.foot import foot_motion
from pdrbench_sim.people.body_line import arc_length_m
from pdrbench_sim.people.person import Person, draw_person
from pdrbench_sim.people.route import NavigationMesh, Place, navigation_mesh
from pdrbench_sim.people.strides import NATURAL_GAIT, Stances, stances, strides
from pdrbench_sim.people.walk import BodyPath, SimulatedWalk, body_path
from pdrbench_sim.people.walker import NATURAL_WALK, WalkParams, draw_place, walk_through
from pdrbench_sim.phone.heading import rotation_vector
from pdrbench_sim.phone.magnetometer import PhoneMagnetometerParams, calibrated_field
from pdrbench_sim.phone.phone import phone_motion
from pdrbench_sim.phone.population import ANY_MANNER, PhoneManner
from pdrbench_sim.radio.ble import Beacons, make_beacons, receive_beacons
from pdrbench_sim.radio.networks import OFFICE_NETWORKS, NetworkParams, Networks, make_networks
from pdrbench_sim.radio.scans import PhonePath, scan_walks
from pdrbench_sim.radio.wlan import draw_receiver
from pdrbench_sim.resolution import mag_step_ut, rounded
from pdrbench_sim.units.device import draw_unit
from pdrbench_sim.units.motion import RigidMotion, sample_times
from pdrbench_sim.units.profiles import ImuProfile, imu_profile

SENSORS: Final = ("accel", "gyro", "mag", "rotation", "baro", "wifi", "ble")
ONLY_PHONES: Final = frozenset({"rotation", "ble"})
FOOT: Final = "foot"
FOOT_HZ: Final = 500.0  # of ideal signals: a heel strike rings at 40 Hz, and a unit of 250 Hz needs twice its rate
PHONE_HZ: Final = 200.0
BODY_HZ: Final = 10.0  # of the way of the body, for what changes slowly
BARO_HZ: Final = 10.0
MOUNTING_RAD: Final = math.radians(4.0)  # by which a unit is strapped on askew, each axis, sigma; ours
LEFT_ON_FOOT_UT: Final = (0.0, 3.0)  # of hard iron after calibration of an AHRS, least and most; ours
SOFT_IRON_ON_FOOT: Final = 0.02  # likewise


class SimulationError(PdrbenchError):
    """A walk that cannot be simulated as it was asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class BuildingScene:
    """A building and what its air and its walls do to sensors."""

    building: Building  # the map
    mesh: NavigationMesh  # of its floors
    magnetic: MagneticField  # its magnetic field
    networks: Networks  # its WLAN
    beacons: Beacons  # its Bluetooth beacons


@dataclass(frozen=True, slots=True)
class Setup:
    """What is carried where, and what of it is recorded."""

    mounting: str = FOOT  # "foot", or where a phone is carried: a key of `pdrbench_sim.phone.phone.PLACES`
    switches: tuple[tuple[float, str], ...] = ()  # time and place of carrying, from where the phone is put elsewhere
    device: str = "mtx"  # name of a profile of inertial units
    rate_hz: float | None = None  # of inertial unit, magnetometer and rotation vector; None for that of the profile
    sensors: tuple[str, ...] = ("accel", "gyro", "mag", "baro", "wifi")  # names of the streams to record
    # For so long the unit rests before the walk, and the mean rate of that time is taken off its gyroscope; 0 for a
    # unit as it was switched on.
    rest_s: float = 0.0
    reference_s: float = 1.0  # time between places of the reference of a phone
    # How well a phone's magnetometer is calibrated; None for the defaults.
    compass: PhoneMagnetometerParams | None = None
    # How the phone of one person moves and measures; its profile comes before `device`.
    manner: PhoneManner = ANY_MANNER
    # If given, the reference has places this far apart instead, as a surveyor marks them; least and most.
    waypoint_m: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in self.sensors:
            if name not in SENSORS:
                raise unknown_name("simulated sensor", name, SENSORS)
        imu_profile(self.device)
        if self.mounting == FOOT and self.manner != ANY_MANNER:
            raise SimulationError("a unit on the foot has no manner of a phone; leave it out")
        if not self.rest_s >= 0 or not self.reference_s > 0 or not (self.rate_hz is None or self.rate_hz > 0):
            raise SimulationError(f"rest_s is 0 or more, reference_s and rate_hz are positive; got {self}")
        if self.mounting == FOOT and ONLY_PHONES & set(self.sensors):
            raise SimulationError("a unit on the foot has no rotation vector and no Bluetooth; leave them out")

    @property
    def profile(self) -> ImuProfile:
        """Of the inertial unit."""
        return self.manner.profile or imu_profile(self.device)


ON_FOOT: Final = Setup(rest_s=60.0)
IN_HAND: Final = Setup("hand", device="phone_mid", sensors=SENSORS)
IN_POCKET: Final = replace(IN_HAND, mounting="pocket")


def make_scene(
    rng: np.random.Generator,
    building: Building,
    *,
    networks: NetworkParams = OFFICE_NETWORKS,
    magnetic: MagneticParams | None = None,
) -> BuildingScene:
    """Draws the fields of a building; each of them has a generator of its own.

    Args:
        rng: Two scenes from generators in the same state are equal byte for byte.
        building: Any that a person can walk in.
        networks: How many boxes its WLAN has, and what they send.
        magnetic: What its steel does; None for the defaults.
    """
    for_magnetic, for_networks, for_beacons = rng.spawn(3)
    return BuildingScene(
        building,
        navigation_mesh(building),
        make_magnetic_field(for_magnetic, building, magnetic),
        make_networks(for_networks, building, params=networks),
        make_beacons(for_beacons, building),
    )


def simulate_walk(
    scene: BuildingScene,
    seed: int | Sequence[int],
    setup: Setup = ON_FOOT,
    *,
    duration_s: float = 180.0,
    person: Person | None = None,
    places: Sequence[Place] | None = None,
    walk: WalkParams = NATURAL_WALK,
    name: str = "walk",
) -> Recording:
    """One person's walk through a building, recorded.

    The reference of a foot is where the unit stands at every rest, its first row the start, which is not surveyed. That
    of a phone is the body of its bearer every `Setup.reference_s`, or at waypoints.

    Args:
        scene: Where.
        seed: Numbers; the same ones give the same bytes.
        setup: What is carried and recorded.
        duration_s: The recording ends then, or when there are no more places.
        person: None for a person that is drawn.
        places: To visit, in order; None for places anywhere in the building.
        walk: How people walk through buildings; `run_fraction` makes them run.
        name: Id of the recording.

    Returns:
        Streams of `Setup.sensors`, times in seconds since the beginning of the walk, in whole steps of their devices.

    Raises:
        SimulationError: A duration that is not positive.
        RouteError: No way leads from one place to the next.
    """
    if not 0 < duration_s < math.inf:
        raise SimulationError(f"a walk takes some seconds; got duration_s={duration_s:g}")
    streams = _Streams(seed)
    person = person or draw_person(streams("person"))
    if places is None:
        places = _draw_places(streams("places"), scene, person, duration_s)
    way = walk_through(streams("walk"), scene.mesh, person, places, walk, until_s=duration_s)
    feet = stances(way, streams("gait"), NATURAL_GAIT)
    end_s = min(duration_s, way.end_s + 1.0)
    device = _Device.carried(scene, way, feet, setup, streams, end_s)
    recording = Recording(
        id=name,
        building=scene.building,
        streams={sensor: device.stream(sensor) for sensor in setup.sensors},
        reference=device.reference(),
        subject={"height_m": round(person.height_m, 2)},
        device=f"simulated {setup.device}",
        mounting=setup.mounting,
    )
    return rounded(recording, _steps(setup))


def _steps(setup: Setup) -> dict[str, float]:
    """Of the devices that are carried."""
    unit = setup.profile
    return {"accel": unit.accel.step, "gyro": unit.gyro.step, "mag": mag_step_ut(setup.mounting)}


class _Streams:
    """Generators by name, each independent of which others are asked for."""

    def __init__(self, seed: int | Sequence[int]) -> None:
        self._entropy = [seed] if isinstance(seed, int) else list(seed)

    def __call__(self, name: str) -> np.random.Generator:
        return np.random.default_rng([*self._entropy, zlib.crc32(name.encode())])


def _draw_places(rng: np.random.Generator, scene: BuildingScene, person: Person, duration_s: float) -> list[Place]:
    """More places than one can visit in that time: a leg is some 10 m long, or it takes a pause of some seconds."""
    count = 3 + math.ceil(duration_s / 6.0)
    return [draw_place(rng, scene.mesh) for _ in range(count)]


@dataclass(frozen=True, eq=False)
class _Device:
    """What is carried through a walk, how it moves, and what it records."""

    scene: BuildingScene
    setup: Setup
    streams: _Streams
    own: Stances  # rests of the foot that bears the unit, also after the end of the recording
    body: BodyPath  # way of the body
    motion: RigidMotion  # of the device, from t = 0
    end_s: float  # of the recording

    @classmethod
    def carried(
        cls,
        scene: BuildingScene,
        way: SimulatedWalk,
        feet: tuple[Stances, Stances],
        setup: Setup,
        streams: _Streams,
        end_s: float,
    ) -> _Device:
        own = feet[int(streams("side").integers(2))]
        if setup.mounting == FOOT:
            motion = foot_motion(scene.building, own, streams("motion"), end_s=end_s, rate_hz=FOOT_HZ)
            askew = MOUNTING_RAD * streams("mounting").standard_normal((3, 1))
            motion = motion.mounted(from_yaw_pitch_roll(*askew)[0])
        else:
            carry = ((0.0, setup.mounting), *setup.switches)
            motion = phone_motion(
                way,
                feet,
                streams("motion"),
                carry=carry,
                rate_hz=PHONE_HZ,
                gait=setup.manner.trunk,
                carried=setup.manner.carried,
            )
        return cls(scene, setup, streams, own, body_path(way, BODY_HZ), motion, end_s)

    def stream(self, sensor: str) -> SensorStream:
        """What one sensor delivered."""
        record: Mapping[str, Callable[[], FloatArray]] = {
            "accel": lambda: self._inertial[0],
            "gyro": lambda: self._inertial[1],
            "mag": lambda: np.column_stack([self._sampled[0], self._measured_ut]),
            "rotation": self._rotation,
            "baro": self._baro,
            "wifi": self._wifi,
            "ble": self._ble,
        }
        return SensorStream(replace(sensor_spec(sensor), rate_hz=self._nominal_hz(sensor)), record[sensor]())

    @property
    def rate_hz(self) -> float:
        """Of the inertial unit and what is sampled with it."""
        return self.setup.rate_hz or self.setup.profile.rate_hz

    def _nominal_hz(self, sensor: str) -> float | None:
        """Rate of a stream; None where rows are events."""
        if sensor in ("wifi", "ble"):
            return None
        return BARO_HZ if sensor == "baro" else self.rate_hz

    # What is sampled with the inertial unit.

    @functools.cached_property
    def _inertial(self) -> tuple[FloatArray, FloatArray]:
        """(n, 4) rows of accel and of gyro, with the rest before the walk cut off and its mean rate taken off."""
        profile = replace(self.setup.profile, rate_hz=self.rate_hz)
        unit = draw_unit(profile, self.streams("unit"))
        motion, rest_s = _rested(self.motion, self.setup.rest_s)
        t_s, accel, gyro = unit.measure(motion.t_s, *motion.ideal_signals(), self.streams("inertial"))
        resting = t_s < 0.0
        if rest_s > 0:
            gyro = gyro - gyro[resting].mean(axis=0)
        kept = ~resting & (t_s <= self.end_s)
        return tuple(np.column_stack([t_s, values])[kept] for values in (accel, gyro))  # type: ignore[return-value]

    @functools.cached_property
    def _sampled(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times (m,), attitudes (m, 4) and the field met (m, 3) wherever the magnetometer is read."""
        t_s, row = sample_times(self.motion, self.end_s, self.rate_hz)
        field_ut = self.scene.magnetic.at(self.motion.xyz_m[row], self._ground_m(t_s))
        return t_s, self.motion.quaternion[row], field_ut

    def _ground_m(self, t_s: FloatArray) -> FloatArray:
        """(m,) the floor under the feet: the lower one of the last rest and the next."""
        floor_m = self.scene.building.height(self.own.polygon)
        last = np.clip(np.searchsorted(self.own.mid_s, t_s, side="right") - 1, 0, len(floor_m) - 1)
        return np.minimum(floor_m[last], floor_m[np.minimum(last + 1, len(floor_m) - 1)])

    @functools.cached_property
    def _measured_ut(self) -> FloatArray:
        """(m, 3) what the magnetometer makes of the field."""
        t_s, quaternion, field_ut = self._sampled
        rng = self.streams("mag")
        if self.setup.mounting != FOOT:
            return calibrated_field(t_s, field_ut, quaternion, rng, self.setup.compass)
        errors = draw_magnetometer(
            self.streams("magnetometer"), hard_iron_ut=LEFT_ON_FOOT_UT, soft_iron=SOFT_IRON_ON_FOOT
        )
        return errors.measure(field_ut, quaternion, rng)

    def _rotation(self) -> FloatArray:
        """Rows of the attitude that a phone works out."""
        t_s, quaternion, _ = self._sampled
        met_ut = to_world(quaternion, self._measured_ut)
        attitude = self.setup.manner.attitude
        return np.column_stack([t_s, rotation_vector(t_s, quaternion, met_ut, self.streams("rotation"), attitude)])

    # What is read along the way.

    @functools.cached_property
    def _path(self) -> PhonePath:
        """Of the body until the end of the recording: a phone on it scans."""
        body, till = self.body, self.body.t_s <= self.end_s
        return PhonePath(body.t_s[till], body.polygon[till], body.xy_m[till], body.heading_rad[till])

    def _baro(self) -> FloatArray:
        """Rows of the barometer."""
        t_s = np.arange(math.floor(self.end_s * BARO_HZ) + 1) / BARO_HZ
        z_m = np.interp(t_s, self.motion.t_s, self.motion.xyz_m[:, 2])
        errors = barometer.draw_barometer(self.streams("barometer"))
        return np.column_stack([t_s, barometer.measure(t_s, z_m, self.streams("baro"), errors)])

    def _wifi(self) -> FloatArray:
        """Rows of the scans."""
        rng, receiver = self.streams("wifi"), draw_receiver(self.streams("receiver"))
        return scan_walks(self.scene.networks, [rng], [self._path], receiver=receiver)[0]

    def _ble(self) -> FloatArray:
        """Rows of the beacons."""
        return receive_beacons(self.scene.beacons, self.streams("ble"), self._path)

    # Where the pedestrian is.

    def reference(self) -> Trajectory:
        """Of the foot at its rests, or of the body."""
        return self._rests() if self.setup.mounting == FOOT else self._places()

    def _rests(self) -> Trajectory:
        building, own = self.scene.building, self.own.until(self.end_s)
        return Trajectory(
            t_s=own.mid_s,
            xy_m=own.xy_m,
            level=building.level(own.polygon),
            surveyed=np.arange(len(own)) > 0,
            heading_rad=strides(building, own).heading_rad if len(own) > 1 else own.yaw_rad,
            z_m=building.height(own.polygon),
        )

    def _places(self) -> Trajectory:
        body = self.body
        row = self._waypoints() if self.setup.waypoint_m else self._seconds()
        return Trajectory(
            t_s=body.t_s[row],
            xy_m=body.xy_m[row],
            level=self.scene.building.level(body.polygon[row]),
            surveyed=np.arange(len(row)) > 0,
            heading_rad=wrap_rad(body.heading_rad[row]),
            z_m=body.z_m[row],
        )

    def _seconds(self) -> IntArray:
        """(T,) rows of the body's way, evenly in time."""
        t_s = np.arange(math.floor(self.end_s / self.setup.reference_s + 1e-9) + 1) * self.setup.reference_s
        rows: IntArray = np.unique(np.minimum(np.rint(t_s * BODY_HZ).astype(np.int64), len(self.body.t_s) - 1))
        return rows

    def _waypoints(self) -> IntArray:
        """(T,) rows of the body's way at which a surveyor marks a place: when setting off, on the way, on arrival."""
        assert self.setup.waypoint_m is not None
        till = int(np.searchsorted(self.body.t_s, self.end_s, side="right"))
        s_m = arc_length_m(self.body.xy_m[:till])
        gaps_m = self.streams("waypoints").uniform(*self.setup.waypoint_m, 1 + int(s_m[-1] / self.setup.waypoint_m[0]))
        marks_m = np.cumsum(gaps_m)
        marks_m = marks_m[marks_m < s_m[-1] - self.setup.waypoint_m[0] / 2]
        off, arrived = np.searchsorted(s_m, 1e-6) - 1, np.searchsorted(s_m, s_m[-1] - 1e-6)
        rows: IntArray = np.unique(np.concatenate([[max(off, 0)], np.searchsorted(s_m, marks_m), [arrived]]))
        return rows


def _rested(motion: RigidMotion, rest_s: float) -> tuple[RigidMotion, float]:
    """The motion after so much rest in its first pose, before t = 0."""
    count = round(rest_s * motion.rate_hz)
    if not count:
        return motion, 0.0
    step_s = 1.0 / motion.rate_hz
    return (
        RigidMotion(
            np.arange(-count, len(motion)) * step_s + motion.t_s[0],
            np.concatenate([np.repeat(motion.xyz_m[:1], count, axis=0), motion.xyz_m]),
            np.concatenate([np.repeat(motion.quaternion[:1], count, axis=0), motion.quaternion]),
        ),
        count * step_s,
    )
