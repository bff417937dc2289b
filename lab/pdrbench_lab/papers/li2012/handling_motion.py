"""A phone that is handled by a person who stands: picked up, turned, tapped on, played with, put away.

What it measures looks like steps to a detector that only counts peaks (L8); parameters: TC1 (sources.md 1.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import from_yaw_pitch_roll, multiply
from pdrbench_sim.phone.gait import ease
from pdrbench_sim.units.motion import GRAVITY_MPS2, MotionError, RigidMotion

MAX_TILT_RAD: Final = 1.3  # a screen is turned back before it faces the floor; ours
LIFT_TILT_RAD: Final = 0.5  # by which the top edge rises when a phone is picked up; ours
MAX_DURATION_S: Final = 86_400.0
RATE_HZ: Final = 200.0


@dataclass(frozen=True, slots=True)
class HandlingParams:
    """How phones are handled; pairs are ranges of a uniform draw, of its logarithm where a ratio is meant."""

    every_s: float = 6.0  # mean time between the beginnings of bursts; sources.md 1.4
    burst_s: tuple[float, float] = (0.2, 3.0)  # how long a burst lasts; logarithmic; sources.md 1.4
    burst_hz: tuple[float, float] = (0.3, 4.0)  # what a burst is made of; logarithmic; sources.md 1.4
    burst_g: tuple[float, float] = (0.1, 1.5)  # root mean square of its acceleration; logarithmic; sources.md 1.4
    # Slow bursts stay within this distance, whatever their acceleration.
    max_offset_m: float = 0.4  # ours: an arm's reach
    # By how much the attitude jumps.
    turn_rad: tuple[float, float] = (math.radians(30), math.radians(120))  # sources.md 1.4
    turn_s: tuple[float, float] = (0.3, 0.9)  # how long a jump takes; ours
    tap_s: tuple[float, float] = (0.02, 0.06)  # width of a tap; sources.md 1.4
    tap_mps2: tuple[float, float] = (1.0, 8.0)  # peak of its acceleration; ours
    taps_hz: tuple[float, float] = (2.0, 6.0)  # how fast taps follow each other; ours
    # How high the phone is picked up, and let down.
    lift_m: tuple[float, float] = (0.2, 0.5)  # ours: between a table or pocket and the eyes
    lift_s: tuple[float, float] = (0.5, 1.2)  # how long that takes; ours
    game_s: tuple[float, float] = (3.0, 10.0)  # how long games last; ours
    game_hz: tuple[float, float] = (1.0, 3.0)  # their rhythm; sources.md 1.4
    game_g: tuple[float, float] = (0.1, 0.5)  # root mean square of their acceleration; ours
    # How often a burst shakes, turns, taps, lifts, plays.
    fractions: tuple[float, float, float, float, float] = (0.35, 0.25, 0.2, 0.12, 0.08)  # ours

    def __post_init__(self) -> None:
        if not 0 < self.every_s < math.inf or not math.isclose(sum(self.fractions), 1.0) or min(self.fractions) < 0:
            raise MotionError(f"bursts come every so many seconds and their fractions add up to 1; got {self}")


def handling_motion(
    rng: np.random.Generator,
    duration_s: float,
    xyz_m: ArrayLike,
    *,
    rate_hz: float = RATE_HZ,
    params: HandlingParams | None = None,
) -> RigidMotion:
    """A phone handled by a person who stands or sits.

    Args:
        rng: When what is done.
        duration_s: More than a second.
        xyz_m: (3,) where the phone is held, in the building.
        rate_hz: Of the samples.
        params: None for the defaults.

    Raises:
        MotionError: No duration to speak of, or a place that is none.
    """
    params = params or HandlingParams()
    middle_m = np.asarray(xyz_m, dtype=np.float64)
    if not 1.0 <= duration_s <= MAX_DURATION_S or middle_m.shape != (3,) or not np.isfinite(middle_m).all():
        raise MotionError(
            f"a phone is handled for a second or more, at a place x, y, z in metres; got {duration_s:g} s at {xyz_m!r}"
        )
    t_s = np.arange(math.floor(duration_s * rate_hz + 1e-9) + 1) / rate_hz
    how, tremble = rng.spawn(2)
    start_rad = np.array([how.uniform(0.2, 0.9), 0.0, how.uniform(-math.pi, math.pi)])
    hand = _handled(t_s, how, params, start_rad)
    hand.tremble(tremble)
    return RigidMotion(t_s, middle_m + hand.offset_m, _quaternion(hand.turn_rad))


def _handled(t_s: FloatArray, rng: np.random.Generator, params: HandlingParams, start_rad: FloatArray) -> _HandledPhone:
    """Acts begin as a Poisson process."""
    when, how = rng.spawn(2)
    count = when.poisson((t_s[-1] - t_s[0]) / params.every_s)
    begin_s = np.sort(when.uniform(t_s[0], t_s[-1], count))
    hand = _HandledPhone(t_s, how, params, start_rad)
    for at_s, kind in zip(begin_s.tolist(), when.choice(list(ACTS), count, p=params.fractions).tolist(), strict=True):
        ACTS[kind](hand, at_s)
    hand.settle()
    return hand


def _quaternion(turn_rad: FloatArray) -> FloatArray:
    """(n, 4) wxyz of angles (n, 3) about x, y and z: first about the building's z, then x, then y of the phone."""
    yaw, tilt, lean = turn_rad[:, 2], turn_rad[:, 0], turn_rad[:, 1]
    none = np.zeros(len(yaw))
    return multiply(from_yaw_pitch_roll(yaw, none, tilt), from_yaw_pitch_roll(none, lean, none))


class _HandledPhone:
    """Displacement and attitude of a phone, as acts are added; each of them smooth, from rest to rest."""

    def __init__(
        self, t_s: FloatArray, rng: np.random.Generator, params: HandlingParams, start_rad: FloatArray
    ) -> None:
        self.t_s, self.rng, self.params = t_s, rng, params
        self.offset_m = np.zeros((len(t_s), 3))
        self.turn_rad = np.zeros((len(t_s), 3))  # about x, y and z, see `_quaternion`
        # What stays after an act is kept as differences from sample to sample and added up once, by `settle`.
        self.shift_m = np.zeros((len(t_s), 3))
        self.jump_rad = np.zeros((len(t_s), 3))
        self.jump_rad[0] = start_rad
        self.now_rad = start_rad.copy()
        self.lifted_m = 0.0

    def settle(self) -> None:
        """Adds up what stays."""
        self.offset_m += np.cumsum(self.shift_m, axis=0)
        self.turn_rad += np.cumsum(self.jump_rad, axis=0)

    def tremble(self, rng: np.random.Generator) -> None:
        """What a hand that holds still does: a few millimetres and a degree, slowly."""
        for hz, size_m, size_rad in ((0.3, 4e-3, 0.02), (1.1, 6e-4, 6e-3), (8.0, 2e-5, 8e-4)):
            rates = 2 * np.pi * hz * rng.uniform(0.7, 1.3, 6)
            waves = np.sin(self.t_s[:, None] * rates + rng.uniform(0, 2 * np.pi, 6))
            self.offset_m += size_m * waves[:, :3]
            self.turn_rad += size_rad * waves[:, 3:]

    def shake(self, at_s: float) -> None:
        """Noise of a band of an octave."""
        hz = self.ratio(self.params.burst_hz)
        lasts_s = max(self.ratio(self.params.burst_s), 0.5 / hz)
        self.oscillate(at_s, lasts_s, hz * np.array([0.75, 1.0, 1.3]), self.ratio(self.params.burst_g))

    def play(self, at_s: float) -> None:
        """A rhythm that hardly changes: the hard case."""
        hz = self.rng.uniform(*self.params.game_hz)
        lasts_s = self.rng.uniform(*self.params.game_s)
        self.oscillate(at_s, lasts_s, hz * np.array([0.985, 1.0, 2.0]), self.rng.uniform(*self.params.game_g))

    def oscillate(self, at_s: float, lasts_s: float, hz: FloatArray, rms_g: float) -> None:
        """Sines under a window, along one direction more than along the others, and turning a little with it."""
        part, since_s = self.span(at_s, lasts_s)
        window = ease(since_s / (0.3 * lasts_s)) * ease((lasts_s - since_s) / (0.3 * lasts_s))
        size = rms_g * GRAVITY_MPS2 * self.direction() / (2 * np.pi * hz[1]) ** 2
        size *= min(1.0, self.params.max_offset_m / float(np.linalg.norm(size)))
        phase = self.rng.uniform(0, 2 * np.pi, (2, len(hz)))
        weight = np.array([0.8, 0.8, 0.3])
        wave, other = (np.sin(2 * np.pi * hz * since_s[:, None] + row) @ weight * window for row in phase)
        self.offset_m[part] += np.outer(wave, size) + 0.3 * np.outer(other, size[[2, 0, 1]])
        self.turn_rad[part] += 1.5 * np.outer(other, self.direction()) * float(np.linalg.norm(size))

    def turn(self, at_s: float) -> None:
        """The attitude jumps, and stays: tilt swings about how a screen is looked at."""
        lasts_s = self.rng.uniform(*self.params.turn_s)
        by_rad = self.rng.uniform(*self.params.turn_rad) * (1 if self.rng.random() < 0.5 else -1)
        axis = int(self.rng.integers(3))
        if axis < 2 and abs(self.now_rad[axis] + by_rad) > MAX_TILT_RAD:
            by_rad = -by_rad
        self.now_rad[axis] += by_rad
        part, risen = self.rise(at_s, lasts_s)
        self.jump_rad[part, axis] += by_rad * risen

    def tap(self, at_s: float) -> None:
        """Some blows of a finger on the screen, mostly along its normal."""
        since_s = np.cumsum(1 / self.rng.uniform(*self.params.taps_hz, int(self.rng.integers(1, 9))))
        for late_s in since_s.tolist():
            width_s = self.rng.uniform(*self.params.tap_s) / 4
            size_m = self.rng.uniform(*self.params.tap_mps2) * width_s**2
            part, after_s = self.span(at_s + late_s, 12 * width_s)
            dent = np.exp(-(((after_s - 6 * width_s) / width_s) ** 2) / 2)
            self.offset_m[part] -= np.outer(dent, size_m * (np.array([0.0, 0.0, 1.0]) + 0.2 * self.direction()))

    def lift(self, at_s: float) -> None:
        """The phone is picked up, or put away where it was picked up before."""
        lasts_s = self.rng.uniform(*self.params.lift_s)
        by_m = -self.lifted_m if self.lifted_m else self.rng.uniform(*self.params.lift_m)
        self.lifted_m += by_m
        part, risen = self.rise(at_s, lasts_s)
        self.shift_m[part] += np.outer(risen, by_m * np.array([0.3, 0.0, 1.0]))
        self.jump_rad[part, 0] += math.copysign(LIFT_TILT_RAD, by_m) * risen

    def rise(self, at_s: float, lasts_s: float) -> tuple[slice, FloatArray]:
        """Samples of a span, and by how much something has risen from 0 to 1 since the sample before."""
        part, since_s = self.span(at_s, lasts_s)
        risen = ease(since_s / lasts_s)
        if len(risen):
            risen[-1] = 1.0
        return part, np.diff(risen, prepend=0.0)

    def span(self, at_s: float, lasts_s: float) -> tuple[slice, FloatArray]:
        """Samples of a span, and the seconds since it began."""
        part = slice(*np.searchsorted(self.t_s, [at_s, at_s + lasts_s]))
        return part, self.t_s[part] - at_s

    def direction(self) -> FloatArray:
        """(3,) of unit length."""
        drawn = self.rng.standard_normal(3)
        return np.asarray(drawn / np.linalg.norm(drawn))

    def ratio(self, bounds: tuple[float, float]) -> float:
        """Uniform in the logarithm."""
        return float(np.exp(self.rng.uniform(*np.log(bounds))))


ACTS: Final = {
    "shake": _HandledPhone.shake,
    "turn": _HandledPhone.turn,
    "tap": _HandledPhone.tap,
    "lift": _HandledPhone.lift,
    "play": _HandledPhone.play,
}
