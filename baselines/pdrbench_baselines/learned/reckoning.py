"""Displacements second by second while the samples of a phone come in."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing
from pdrbench_baselines.learned.attitude_sources import PHONE, OwnAttitudeSource, rows_of
from pdrbench_baselines.learned.row_checks import SENSORS, RowChecks
from pdrbench_baselines.learned.signals import (
    HORIZON,
    RATE_HZ,
    WINDOW,
    gaps_filled,
    grid_signals,
    turned,
    window_before,
)

KEPT_S: Final = WINDOW / RATE_HZ + 1.5
EVERY_S: Final = HORIZON / RATE_HZ
# Standard deviation of the force of a second in m/s2, below which a phone is at rest: who stands in a museum shakes it
# by 0.1 to 0.6, walkers there by 0.8 or more (8 walks of IpinPhone-v1), slow simulated people by 0.4 or more.
AT_REST_MPS2: Final = 0.3
FADES: Final = 0.9  # of a displacement for every second without samples: nearly all who walked still do
# Fraction of its squared length by which the variance per axis of a second grows: of one that repeats another, and, for
# every second that is missing up to then, of one in a gap. Of gaps cut out of 30 train walks through malls it is 0.02
# to 0.07 where a second or less is missing, 0.04 to 0.09 where two or three are.
REPEATED_FRACTION: Final = 0.25
GAP_FRACTION: Final = 0.1
# Of 1, 2 and 3 m this errs least on 40 train walks of CampusPhone-v1 without attitudes: 5.4, 5.1 and 6.0 m.
ALIGNED_AFTER_M: Final = 2.0
ROUNDING_S: Final = 1e-6  # of times


@dataclass(frozen=True, slots=True)
class WindowAnswer:
    """What a network says of a window.

    Attributes:
        move_m: (2,) displacement of its last second in the frame of the window.
        cholesky_m: (2, 2) lower triangular factor of its covariance.
        standing: Logit of standing still.
    """

    move_m: FloatArray
    cholesky_m: FloatArray
    standing: float


class WindowNetwork(Protocol):
    """A network in the state of being asked."""

    def ask(self, features: FloatArray, height_m: float) -> WindowAnswer:
        """What is said of one window (`CHANNELS`, `WINDOW`); the height is that of the person, 0 where unknown."""


@dataclass(frozen=True, slots=True)
class Move:
    """One second.

    Attributes:
        end_s: When it ended.
        move_m: (2,) in the frame of the rotation vector.
        covariance_m2: (2, 2) of it.
        stands: Whether the network takes its bearer to stand.
        is_guess: True where samples were missing: their gait goes on, or else the last move, fading.
        compass_rad: By how much the frame is turned to the mean of the compass so far from one that follows the
            gyroscope alone, in the middle of the second; None without a compass.
    """

    end_s: float
    move_m: FloatArray
    covariance_m2: FloatArray
    stands: bool
    is_guess: bool
    compass_rad: float | None = None


class Reckoner:
    """Takes the rows of a phone and reports by how much its bearer moves.

    Of seconds of which samples are missing, the network is asked with signals whose gait goes on (`gaps_filled`); where
    too little came before, the displacement before goes on, fading.

    Args:
        network: In the state of being asked.
        briefing: Gives sensors and the height of the person.
        length_factor: On displacements.

    Raises:
        UnsuitableError: A sensor is missing or too slow, or what carries them is no phone.
    """

    def __init__(self, network: WindowNetwork, briefing: Briefing, *, length_factor: float = 1.0) -> None:
        self._length_factor, self._missing_s = length_factor, 0.0
        self._unknown_ends_s: list[float] = []  # of seconds before the first one that is known
        self._source = source = rows_of(briefing)
        briefing.require(sensors=source.sensors, min_rate_hz=source.min_rate_hz, carrier=PHONE)
        self._network = network
        self._start_rad = 0.0 if briefing.start is None else briefing.start.heading_rad or 0.0
        names = dict.fromkeys(
            (*source.sensors, *({"mag"} & briefing.sensors.keys()))
        )  # a field helps, none is waited for
        self._waiting: dict[str, list[FloatArray]] = {name: [] for name in names}
        self._newest_s = dict.fromkeys(source.sensors, -math.inf)
        self._rows: dict[str, FloatArray] = {name: np.zeros((0, 5 if name == "rotation" else 4)) for name in SENSORS}
        self._compass: FloatArray = np.zeros((0, 2))
        height_m = briefing.subject.get("height_m", 0.0)
        self._height_m = float(height_m) if isinstance(height_m, int | float) else 0.0
        self._checks = RowChecks("learned", self._rows)
        self._held: list[Move] = []
        self._first_s: float | None = None
        self._last: Move | None = None

    @property
    def has_compass(self) -> bool:
        """Whether displacements are turned to the mean of a compass."""
        return bool({"rotation", "mag"} & set(self._source.sensors))

    def update(self, rows: Mapping[str, FloatArray]) -> Iterator[Move]:
        """Takes the next rows and gives the seconds that are complete with them, once it is known whither they lead.

        Raises:
            RecordingError: Other units than m/s2 and rad/s, or times that go back.
        """
        self._held += self._seconds(rows)
        self._align()
        turn_rad = self._source.turn_rad
        if turn_rad is not None:
            for move in (_turned(one, turn_rad) for one in self._held):
                yield replace(move, move_m=self._length_factor * move.move_m)
            self._held = []

    def _align(self) -> None:
        """Turns the frame so that the first displacements lead along the heading of the start."""
        if isinstance(self._source, OwnAttitudeSource) and self._source.turn_rad is None and self._held:
            x_m, y_m = np.sum([move.move_m for move in self._held], axis=0)
            if math.hypot(x_m, y_m) >= ALIGNED_AFTER_M:
                self._source.turn_rad = self._start_rad - math.atan2(y_m, x_m)

    def _seconds(self, rows: Mapping[str, FloatArray]) -> Iterator[Move]:
        """Those that are complete, in the frame of the rotation vector."""
        for name, waiting in self._waiting.items():
            is_finite = np.isfinite(rows[name])
            waiting.append(rows[name].copy() if is_finite.all() else rows[name][is_finite.all(axis=1)])
            if len(waiting[-1]) and name in self._newest_s:
                self._newest_s[name] = max(self._newest_s[name], float(waiting[-1][-1, 0]))
        if self._first_s is not None and self._source.turn_rad is not None and not self._is_due:
            return
        self._take()
        if any(len(one) < 2 for one in self._rows.values()):
            return
        if self._first_s is None:
            self._first_s = max(float(one[0, 0]) for one in self._rows.values())
            self._end_s = self._first_s + EVERY_S
        newest_s = max(float(one[-1, 0]) for one in self._rows.values())
        ready_s = min(float(one[-1, 0]) for one in self._rows.values())
        if newest_s - ready_s > EVERY_S:
            ready_s = newest_s - EVERY_S  # a sensor has stopped
        while self._end_s <= ready_s + ROUNDING_S:
            yield from self._with_unknown(self._move(self._end_s))
            self._end_s += EVERY_S
        self._forget()

    @property
    def _is_due(self) -> bool:
        """Whether a second may be complete with the rows that wait."""
        latest_s = self._newest_s.values()
        return min(latest_s) >= self._end_s - ROUNDING_S or max(latest_s) > self._end_s + EVERY_S - ROUNDING_S

    def _take(self) -> None:
        """Gives the rows that wait an attitude: a second of them costs hardly more than a fifth of one."""
        if not all(self._waiting.values()):
            return
        new = {name: np.concatenate(waiting) for name, waiting in self._waiting.items()}
        self._waiting = {name: [] for name in self._waiting}
        given = self._source.update(new)
        self._checks.take(new if "rotation" in new else given)
        for name in SENSORS:
            self._rows[name] = np.concatenate([self._rows[name], given[name]])
        if "compass" in given:
            self._compass = np.concatenate([self._compass, given["compass"]])

    def _with_unknown(self, move: Move | None) -> Iterator[Move]:
        """A second; with the first that is known those before it, which fade backwards from it."""
        if move is None:
            self._unknown_ends_s.append(self._end_s)
            return
        for back, end_s in zip(range(len(self._unknown_ends_s), 0, -1), self._unknown_ends_s, strict=True):
            faded = replace(move, end_s=end_s, move_m=FADES**back * move.move_m)
            yield _as_guess(faded, REPEATED_FRACTION)
        self._unknown_ends_s = []
        yield move

    def _seen(self, end_s: float) -> tuple[tuple[FloatArray, float] | None, float]:
        """The window before a time with its yaw, None where its last second is not known; and what is missing of it."""
        assert self._first_s is not None
        begin_s = max(end_s - WINDOW / RATE_HZ, self._first_s) + 1.0 / RATE_HZ
        signals = grid_signals(self._rows["accel"], self._rows["gyro"], self._rows["rotation"], begin_s, end_s)
        missing_s = np.count_nonzero(~signals.is_whole[-HORIZON:]) / RATE_HZ
        signals = gaps_filled(signals)
        if len(signals) < HORIZON:
            return None, missing_s
        return window_before(signals, len(signals)), missing_s

    def _move(self, end_s: float) -> Move | None:
        """The second that ends at a time; None before one is known."""
        window, missing_s = self._seen(end_s)
        self._missing_s = self._missing_s + missing_s if missing_s else 0.0
        if window is None:
            if self._last is None:
                return None
            faded = replace(self._last, end_s=end_s, move_m=FADES * self._last.move_m)
            move = _as_guess(faded, REPEATED_FRACTION)
        else:
            move = self._asked(end_s, *window)
            if missing_s:
                move = _as_guess(move, GAP_FRACTION * self._missing_s)
        if len(self._compass):
            move = replace(move, compass_rad=float(np.interp(end_s - EVERY_S / 2, *self._compass.T)))
        self._last = move
        return move

    def _asked(self, end_s: float, features: FloatArray, yaw_rad: float) -> Move:
        """The second that ends with a window."""
        said = self._network.ask(features, self._height_m)
        shaking_mps2 = math.sqrt(features[:3, -HORIZON:].var(axis=1).sum())
        stands = said.standing > 0.0 or shaking_mps2 < AT_REST_MPS2
        move_m = np.zeros(2) if stands else turned(said.move_m, yaw_rad)
        factor = turned(said.cholesky_m.T, yaw_rad).T
        return Move(end_s, move_m, factor @ factor.T, stands, False)

    def _forget(self) -> None:
        for name, rows in self._rows.items():
            first = int(np.searchsorted(rows[:, 0], self._end_s - EVERY_S - KEPT_S))
            self._rows[name] = rows[min(first, max(len(rows) - 2, 0)) :]
        first = int(np.searchsorted(self._compass[:, 0], self._end_s - EVERY_S))
        self._compass = self._compass[min(first, max(len(self._compass) - 1, 0)) :]


def _as_guess(move: Move, fraction: float) -> Move:
    """With a variance per axis that is larger by that fraction of its squared length."""
    wider = move.covariance_m2 + np.eye(2) * fraction * float(np.sum(move.move_m**2))
    return replace(move, covariance_m2=wider, is_guess=True)


def _turned(move: Move, turn_rad: float) -> Move:
    """The same in a frame turned by so much; as it is, to the bit, where that is 0."""
    if turn_rad == 0.0:
        return move
    factor: FloatArray = turned(np.linalg.cholesky(move.covariance_m2).T.astype(np.float64), turn_rad).T
    return replace(move, move_m=turned(move.move_m, turn_rad), covariance_m2=factor @ factor.T)
