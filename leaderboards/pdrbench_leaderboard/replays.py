"""Held-out walks of recordings: test walks in another frame, under other names, with a little more noise.

Recorded walks are public, truth included, and no secret makes others of their kind. It makes replays of them: a rigid
motion turns and shifts building, reference, start, radio survey and every stream that holds a place or a direction in
the frame of the building. What is measured in the frame of the device stays, but for the magnetic field: a localizer
that takes y of the map for north is still right. White noise, small against that of the sensors, is added; clocks run
slow by a few microseconds a second; walks, access points, beacons and parts of the building get other names. What a
replay cannot stop stands in `docs/threats.md`.
"""

from __future__ import annotations

import functools
import hashlib
import hmac
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, TypeVar

import numpy as np

from pdrbench.building import Building, FloorPolygon
from pdrbench.building.polygons import WALL
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench.inertial.phone_attitude import PhoneAttitude
from pdrbench.inertial.quaternions import about_vertical, inverse, multiply, to_world
from pdrbench.recording import MagneticMap, RadioMap, Recording, SensorStream
from pdrbench.sensors import BUILTIN, sensor_spec
from pdrbench.task import HELD_OUT, SURVEYS, Task, no_survey
from pdrbench.trajectory import Start, Trajectory
from pdrbench_leaderboard.boards import num_replays

Thing = TypeVar("Thing")

MAX_SHIFT_M: Final = 500.0  # per axis: farther than a building is long, near enough for every digit
MAX_CLOCK_ERROR: Final = 2e-5  # quartz of phones; 2 ms in 100 s
MIN_WALL_M: Final = 1e-9  # shorter ones are rounding in a plan
IDENTIFIERS: Final = ("access_point", "beacon")
PLACE: Final = ("x_m", "y_m")
ATTITUDE: Final = ("qw", "qx", "qy", "qz")
FIELD: Final = ("x_ut", "y_ut", "z_ut")
# Standard deviation of the noise by column, a third at most of the white noise of good sensors, in the bandwidth of
# their streams: 25 ug/sqrt(Hz) and 0.005 degree/s/sqrt(Hz) of a 3DM-GX5-25, 0.6 uT a digit of an AK09911, 1 Pa of a
# barometer, 4 dB of a scan; 1.5 cm and 1 degree of a stride (stride_errors.json of the laboratory).
NOISE: Final = {
    **dict.fromkeys(("x_mps2", "y_mps2", "z_mps2"), 1e-3),
    **dict.fromkeys(("x_radps", "y_radps", "z_radps"), 2e-4),
    **dict.fromkeys(FIELD, 0.1),
    **dict.fromkeys(ATTITUDE, 1e-4),
    **dict.fromkeys(PLACE, 0.02),
    "pressure_hpa": 3e-3,
    "rssi_dbm": 0.5,
    "length_m": 3e-3,
    "height_m": 3e-3,
    "turn_rad": 1e-3,
}


@dataclass(frozen=True, slots=True)
class Motion:
    """A turn about the origin, counter-clockwise, then a shift. Heights and levels stay."""

    turn_rad: float = 0.0
    shift_xy_m: tuple[float, float] = (0.0, 0.0)

    def places(self, xy_m: FloatArray) -> FloatArray:
        """(..., 2) places moved; equal places stay equal to the last bit."""
        cos, sin = math.cos(self.turn_rad), math.sin(self.turn_rad)
        x_m, y_m = xy_m[..., 0], xy_m[..., 1]
        shift_x_m, shift_y_m = self.shift_xy_m
        return np.stack([cos * x_m - sin * y_m + shift_x_m, sin * x_m + cos * y_m + shift_y_m], axis=-1)

    def headings(self, heading_rad: FloatArray | float) -> FloatArray:
        """(...) headings turned; wrapped where they are."""
        return wrap_rad(heading_rad + self.turn_rad) if self.turn_rad else np.asarray(heading_rad)

    def start(self, start: Start) -> Start:
        """The same start in the new frame."""
        heading_rad = None if start.heading_rad is None else float(self.headings(start.heading_rad))
        return replace(start, xy_m=self.places(start.xy_m), heading_rad=heading_rad)

    def reference(self, reference: Trajectory) -> Trajectory:
        """The same trajectory in the new frame."""
        heading_rad = None if reference.heading_rad is None else self.headings(reference.heading_rad)
        return replace(reference, xy_m=self.places(reference.xy_m), heading_rad=heading_rad)

    def building(self, building: Building, rename: Callable[[str], str] = str) -> Building:
        """The same building in the new frame, its own name and those of its parts renamed."""
        polygons = tuple(self._polygon(polygon, rename) for polygon in building.polygons)
        zones = tuple(
            replace(zone, id=rename(zone.id), name=rename(zone.name), outline_xy_m=self.places(zone.outline_xy_m))
            for zone in building.zones
        )
        return Building(rename(building.name), polygons, zones)

    def _polygon(self, polygon: FloorPolygon, rename: Callable[[str], str]) -> FloorPolygon:
        """Without walls so short that the last digits of the new coordinates could fold them."""
        rings, neighbours, first = [], [], 0
        for ring in map(self.places, polygon.rings):
            neighbour = polygon.neighbour[first : first + len(ring)]
            first += len(ring)
            length_m = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
            kept = (length_m > MIN_WALL_M) | (neighbour != WALL)
            rings.append(ring[kept])
            neighbours.append(neighbour[kept])
        neighbour = np.concatenate(neighbours)
        return replace(
            polygon, id=rename(polygon.id), outline_xy_m=rings[0], holes=tuple(rings[1:]), neighbour=neighbour
        )

    def streams(self, recording: Recording) -> dict[str, SensorStream]:
        """The streams of a recording in the new frame."""
        attitude = _attitude(recording) if self.turn_rad else None
        return {name: replace(one, rows=self._rows(one, attitude)) for name, one in recording.streams.items()}

    def _rows(self, stream: SensorStream, attitude: FloatArray | None) -> FloatArray:
        rows, spec = stream.rows.copy(), stream.spec
        place, quaternion, field = (_columns(stream, names) for names in (PLACE, ATTITUDE, FIELD))
        if place:
            rows[:, place] = self.places(rows[:, place])
        if quaternion and self.turn_rad:
            rows[:, quaternion] = multiply(about_vertical(self.turn_rad), rows[:, quaternion])
        if field and attitude is not None and len(attitude):
            latest = np.searchsorted(attitude[:, 0], rows[:, 0], side="right") - 1
            rows[:, field] = self._field(rows[:, field], attitude[np.maximum(latest, 0), 1:])
        return np.clip(rows, spec.low, spec.high)

    def _field(self, field_ut: FloatArray, attitude: FloatArray) -> FloatArray:
        """(n, 3) the field that a device measures whose attitude (n, 4) was turned, in a field that was not."""
        turn = about_vertical(-self.turn_rad)
        return to_world(
            inverse(attitude), to_world(np.broadcast_to(turn, attitude.shape), to_world(attitude, field_ut))
        )


def _columns(stream: SensorStream, names: tuple[str, ...]) -> list[int]:
    """Where these columns stand; empty where a stream lacks one of them."""
    return [stream.spec.index(name) for name in names] if set(names) <= set(stream.spec.columns) else []


def _attitude(recording: Recording) -> FloatArray | None:
    """(n, 5) t_s and attitude, which says where a magnetometer has its vertical; None where nothing reports that.

    Where the phone has no rotation vector, gravity levels the gyroscope. On a foot that does not hold.
    """
    streams = recording.streams
    if "rotation" in streams:
        return streams["rotation"].rows
    if recording.mounting == "foot" or not {"accel", "gyro", "mag"} <= set(streams):
        return None
    return PhoneAttitude().update(streams["accel"].rows, streams["gyro"].rows)


@dataclass(frozen=True, slots=True)
class Disguise:
    """What is done to a walk besides the motion; everything follows from the key.

    Attributes:
        key: Of the walk, made of the secret.
        names_key: Of names, one for all walks: a building has the same one in each.
    """

    key: str
    names_key: str

    def rng(self, what: str) -> np.random.Generator:
        """The generator of one thing."""
        digest = hashlib.sha256(f"{self.key}/{what}".encode()).digest()
        return np.random.default_rng(np.frombuffer(digest, dtype="<u4"))

    def motion(self) -> Motion:
        """Any turn, and any shift up to `MAX_SHIFT_M`."""
        turn_rad, x_m, y_m = self.rng("motion").uniform(-1.0, 1.0, 3) * [math.pi, MAX_SHIFT_M, MAX_SHIFT_M]
        return Motion(float(turn_rad), (float(x_m), float(y_m)))

    def rename(self, name: str) -> str:
        """Another name, the same one for the same name; none stays none."""
        return name and _digest(self.names_key, name)

    def identifiers(self, numbers: FloatArray | IntArray) -> IntArray:
        """Other numbers below 2**48, by a permutation of all of them: the same in survey and scans, no two alike."""
        mask, shift = np.uint64(2**48 - 1), np.uint64(25)
        mixed = numbers.astype(np.uint64)
        for factor, offset in self.rng("identifiers").integers(2**48, size=(3, 2), dtype=np.uint64):
            mixed = ((mixed ^ offset) * (factor | np.uint64(1))) & mask
            mixed ^= mixed >> shift
        return mixed.astype(np.int64)

    def noisy(self, values: FloatArray, sigma: float, rng: np.random.Generator) -> FloatArray:
        """(n,) values with white noise; whole where they are, equal where neighbours are, and in the same range.

        So a sensor at the end of its range stays there, and a value that was held is held.
        """
        fresh = np.cumsum(np.diff(values, prepend=np.nan) != 0) - 1
        noisy: FloatArray = values + sigma * rng.standard_normal(len(values))[fresh]
        if np.array_equal(values, np.rint(values)):
            noisy = np.rint(noisy)
        return noisy.clip(values.min(initial=np.inf), values.max(initial=-np.inf))

    def stream(self, stream: SensorStream) -> SensorStream:
        """A stream of another unit of the same make, on another clock."""
        spec, rows, rng = stream.spec, stream.rows.copy(), self.rng(f"stream {stream.spec.name}")
        rows[:, 0] *= 1.0 - MAX_CLOCK_ERROR * self.rng("clock").random()
        for column, name in enumerate(spec.columns):
            if name in IDENTIFIERS:
                rows[:, column] = self.identifiers(rows[:, column])
            elif name in NOISE:
                rows[:, column] = self.noisy(rows[:, column], NOISE[name], rng)
        if quaternion := _columns(stream, ATTITUDE):
            rows[:, quaternion] /= np.linalg.norm(rows[:, quaternion], axis=1, keepdims=True)
        return replace(stream, rows=np.clip(rows, spec.low, spec.high))

    def radio_map(self, radio_map: RadioMap) -> RadioMap:
        """A survey moved as the walk is, with the same access points as its scans."""
        return replace(
            radio_map,
            xy_m=self.motion().places(radio_map.xy_m),
            access_point=self.identifiers(radio_map.access_point),
            rssi_dbm=self.noisy(radio_map.rssi_dbm, NOISE["rssi_dbm"], self.rng("survey")),
        )

    def magnetic_map(self, magnetic_map: MagneticMap) -> MagneticMap:
        """A survey moved as the walk is; its field is that in the frame of a phone, which a turn of the map leaves."""
        rng = self.rng("magnetic survey")
        field_ut = [self.noisy(column, NOISE[FIELD[0]], rng) for column in magnetic_map.field_ut.T]
        xy_m = self.motion().places(magnetic_map.xy_m)
        return replace(magnetic_map, xy_m=xy_m, field_ut=np.column_stack(field_ut))

    def recording(self, recording: Recording, walk: str) -> Recording:
        """A recording moved and disguised, under another id."""
        motion, building = self.motion(), recording.building
        streams = {name: self.stream(stream) for name, stream in motion.streams(recording).items()}
        return replace(
            recording,
            id=walk,
            building=None if building is None else motion.building(building, self.rename),
            streams=streams,
            reference=motion.reference(recording.reference),
        )


def replayed(task: Task, secret: str) -> Task:
    """The same task with a split "heldout": a replay of each of its test walks, in an order that says nothing.

    Where there are fewer than `MIN_REPLAYS` test walks, each is replayed twice, in two frames.

    Args:
        task: Its walks are recorded, or it says nothing of how others could be made.
        secret: Everything that is changed follows from it.

    Raises:
        PdrbenchError: It has no test walks, or a sensor whose columns may or may not turn with the map.
    """
    known = {column for name in BUILTIN for column in sensor_spec(name).columns}
    for spec in task.sensors:
        if unknown := [column for column in spec.columns if column not in known]:
            raise PdrbenchError(
                f"{task.id} has no held-out walks: nothing says whether {unknown[0]!r} of the sensor {spec.name!r} "
                f"turns with the map; call it as a column of a built-in sensor with the same meaning, as x_m and y_m"
            )
    key = hmac.new(secret.encode(), task.id.encode(), hashlib.sha256).hexdigest()
    tested = task.split("test")
    times = ("", "/2") if num_replays(len(tested)) > len(tested) else ("",)
    inner = {f"{HELD_OUT}-{_digest(key, f'{walk}{time}')}": walk for time in times for walk in tested}
    disguises = {walk: Disguise(hashlib.sha256(f"{key}/{walk}".encode()).hexdigest(), key) for walk in inner}

    @functools.lru_cache(maxsize=2)
    def original(walk: str) -> Recording:
        return task.load(inner[walk])

    @functools.lru_cache(maxsize=len(SURVEYS))  # of up to 30 MB
    def survey(walk: str, kind: str) -> Any:
        found = getattr(task, kind)(original(walk))
        return None if found is None else getattr(disguises[walk], kind)(found)

    def load(walk: str) -> Recording:
        return disguises[walk].recording(original(walk), walk) if walk in inner else task.load(walk)

    def tell_start(recording: Recording) -> Start:
        walk = recording.id
        if walk not in inner:
            return task.tell_start(recording)
        return disguises[walk].motion().start(task.tell_start(original(walk)))

    def survey_of(kind: str) -> Callable[[Recording], Any]:
        public = getattr(task, kind)
        return lambda recording: survey(recording.id, kind) if recording.id in inner else public(recording)

    def with_replays(of: Mapping[str, Thing], change: Callable[[Thing], Thing]) -> dict[str, Thing]:
        return {**of, **{walk: change(of[public]) for walk, public in inner.items() if public in of}}

    surveys: dict[str, Any] = {kind: survey_of(kind) for kind in SURVEYS if getattr(task, kind) is not no_survey}
    return replace(
        task,
        walks={**task.walks, HELD_OUT: tuple(sorted(inner))},
        load=load,
        tell_start=tell_start,
        **surveys,
        files_sha256=lambda walk: task.files_sha256(inner.get(walk, walk)),
        units=with_replays(task.units, functools.partial(_digest, key)),
        groups=with_replays(task.groups, lambda groups: groups),
    )


def _digest(key: str, name: str) -> str:
    """Twelve hexadecimal digits."""
    return hmac.new(key.encode(), name.encode(), hashlib.sha256).hexdigest()[:12]
