"""The replica of Li et al. 2012: a corridor of 31 m x 15 m in an office, one lap of it, two phones (claims L1 to L3).

The paper shows its plan without a scale; the loop is stated, the width of the corridor and the rooms are ours. Doors
are closed: the paper's map is made of pathway, room and wall, and a wall removes particles that leave the pathway.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench.recording import Recording
from pdrbench.trajectory import Start
from pdrbench_lab.papers.ring_floor import RingFloor, corridor_polygon, make_ring
from pdrbench_sim.people.person import Person
from pdrbench_sim.people.route import Place
from pdrbench_sim.people.walker import NATURAL_WALK
from pdrbench_sim.phone.magnetometer import PhoneMagnetometerParams
from pdrbench_sim.record import IN_HAND, IN_POCKET, BuildingScene, Setup, make_scene, simulate_walk

CORRIDOR: Final = RingFloor(long_m=31.0, short_m=15.0, width_m=2.0, is_open=False)  # L1; all else is ours
RATE_HZ: Final = 50.0  # L3
SENSORS: Final = ("accel", "gyro", "mag", "rotation")
TAP_SIGMA_M: Final = 0.5  # L3: how far a finger is off, per axis
TAP_RADIUS_M: Final = 2.0  # given: within four standard deviations per axis
TAP_CLEARANCE_M: Final = 0.1  # of a tap from the walls
REFERENCE_S: Final = 0.5  # L2 has a tag every 0.5 m and labels every step, which takes half a second
MAX_DURATION_S: Final = 3600.0  # longer than any walk
# Round and round without a stop: "walked along a 31 x 15 m area". They sway, and keep a little to the right, as people
# do in any corridor.
LAP_WALK: Final = replace(NATURAL_WALK, stop_fraction=0.0, u_turn_fraction=0.0, pause_every_s=1e6)
# Phones of the paper's kind ask to be waved about as soon as their compass is doubtful [R]. So all of them are as the
# median phone is after a calibration, and the long tail of uncalibrated ones is left out.
COMPASS: Final = PhoneMagnetometerParams(left_spread=0.0)
PHONES: Final = {
    place: replace(setup, rate_hz=RATE_HZ, sensors=SENSORS, reference_s=REFERENCE_S, compass=COMPASS)
    for place, setup in (("hand", IN_HAND), ("pocket", IN_POCKET))
}


@dataclass(frozen=True, slots=True)
class Laps:
    """How a person goes round the corridor."""

    begin_m: float  # where, along the middle line
    is_clockwise: bool = False  # which way round
    count: int = 1  # of laps

    def places(self, building: Building) -> list[Place]:
        """To walk past: the start, every corner, the end, which is the start."""
        length_m, polygon = self.count * CORRIDOR.lap_m, int(corridor_polygon(building, 1)[0])
        way_xy_m = CORRIDOR.way_xy_m(self.begin_m, length_m, is_clockwise=self.is_clockwise)
        return [Place(polygon, xy) for xy in way_xy_m]


def draw_laps(rng: np.random.Generator, count: int = 1) -> Laps:
    """Begins anywhere at least 3 m from a corner, either way round."""
    side = int(rng.integers(4))
    length_m = CORRIDOR.long_m if side % 2 == 0 else CORRIDOR.short_m
    begin_m = float(CORRIDOR.corners_m[side]) + float(rng.uniform(3.0, length_m - 3.0))
    return Laps(begin_m, bool(rng.random() < 0.5), count)


def make_corridor() -> Building:
    """The building: always the same one."""
    return make_ring(CORRIDOR, "corridor")


def make_corridor_scene(rng: np.random.Generator) -> BuildingScene:
    """The building with the magnetic field of an office, another one each time."""
    return make_scene(rng, make_corridor())


def record_laps(
    scene: BuildingScene,
    seed: Sequence[int],
    laps: Laps,
    person: Person,
    setup: Setup = PHONES["hand"],
    *,
    name: str = "walk",
) -> Recording:
    """One walk round the corridor with one phone.

    The same seed with another setup is the same walk, step by step, with the phone elsewhere; its two phones then also
    have the errors of one unit.

    Args:
        scene: Of `make_corridor_scene`.
        seed: Numbers; the same ones give the same bytes.
        laps: Where and how far.
        person: Who walks.
        setup: One of `PHONES`.
        name: Id of the recording.

    Returns:
        Streams `SENSORS`; the reference is the body every `REFERENCE_S`, with its heading.
    """
    return simulate_walk(
        scene,
        seed,
        setup,
        duration_s=MAX_DURATION_S,
        person=person,
        places=laps.places(scene.building),
        walk=LAP_WALK,
        name=name,
    )


def tapped(xy_m: FloatArray, rng: np.random.Generator, heading_rad: float | None = None) -> Start:
    """What a user reports who taps on the corridor they stand in, about where.

    A tap beside the corridor counts as one on its nearest place, so that a finger never puts its owner into a room.

    Args:
        xy_m: (2,) where the user is.
        rng: Draws by how much the finger is off.
        heading_rad: Which way the user is about to walk; None where that is not given.
    """
    tap_m = xy_m + TAP_SIGMA_M * rng.standard_normal(2)
    middle_m = CORRIDOR.xy_m(CORRIDOR.along_m(tap_m[None]))[0]
    aside_m = float(np.hypot(*(tap_m - middle_m)))
    max_m = CORRIDOR.width_m / 2 - TAP_CLEARANCE_M
    if aside_m > max_m:
        tap_m = middle_m + (tap_m - middle_m) * (max_m / aside_m)
    return Start(tap_m, level=0, heading_rad=heading_rad, radius_m=TAP_RADIUS_M)


def start_heading_rad(laps: Laps, place: str) -> float | None:
    """What is known of the heading at the start: assumption 1 of the paper, that the phone's offset from it is.

    A phone in the hand points where its owner walks, so its offset is 0 and nothing is given. For one that went
    into a pocket the direction of the corridor is given.

    Args:
        laps: Which way round.
        place: One of `PHONES`.
    """
    if place == "hand":
        return None
    along_rad = float(CORRIDOR.heading_rad(np.array([laps.begin_m]))[0])
    return float(wrap_rad(along_rad + math.pi)) if laps.is_clockwise else along_rad
