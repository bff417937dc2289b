"""Displacements second by second while the samples of a phone, or of a unit on a foot, come in."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing
from pdrbench_baselines.learned.attitude_sources import PHONE, rows_of
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
STANDS_M: Final = 0.2  # a network that counts steps is taken to say that its bearer stands only if it says less
# Autocorrelation of the shaking at the period of a step, mean of ten seconds: below the first of 75 % of simulated
# carts and of 5 % of pockets, above the second of 95 % of all other simulated people and of 99 % of recorded ones.
RHYTHMS: Final = (0.26, 0.31)
RHYTHM_SECONDS: Final = 10
# Standard deviation of the force of a second in m/s2, below which a phone is at rest: of one that has not shaken in the
# rhythm of steps yet, and so may lie on a trolley, and of one that has. Who stands in a museum shakes a phone by 0.1 to
# 0.6, walkers there by 0.8 or more (8 train and val walks of IpinPhone-v1), slow simulated ones by 0.4 or more.
AT_REST_MPS2: Final = (0.3, 0.4)
STEPLESS_M: Final = 0.5  # sigma of a second in which something rolls, at any speed of a walker
MAX_DOUBT: Final = 0.5  # with more, whether the bearer stands is not taken from the network
# Half the squared distance of two networks' displacements by both covariances, mean of ten seconds: below the
# first in 95 % of seconds in a hand or a pocket, above the second where one has not learned how the phone is carried.
APART: Final = (0.7, 1.5)
APART_SECONDS: Final = 10
FADES: Final = 0.9  # of a displacement for every second without samples: nearly all who walked still do
# Fraction of its squared length by which the variance per axis of a second grows: of one that repeats another, and, for
# every second that is missing up to then, of one in a gap. Of gaps cut out of 30 train walks through malls it is 0.02
# to 0.07 where a second or less is missing, 0.04 to 0.09 where two or three are.
REPEATED_FRACTION: Final = 0.25
GAP_FRACTION: Final = 0.1
ROUNDING_S: Final = 1e-6  # of times


@dataclass(frozen=True, slots=True)
class WindowAnswer:
    """What a network says of a window.

    Attributes:
        move_m: (2,) displacement of its last second in the frame of the window.
        length_m: Expected length of it.
        cholesky_m: (2, 2) lower triangular factor of its covariance.
        standing: Logit of standing still.
        doubt: 0 for input like that of training, towards 1 the further from it, of a network that says so.
        rhythm: Largest autocorrelation of the shaking at the period of a step; not a number where nothing shakes.
    """

    move_m: FloatArray
    length_m: float
    cholesky_m: FloatArray
    standing: float
    doubt: float | None
    rhythm: float


class WindowNetwork(Protocol):
    """A network in the state of being asked.

    Attributes:
        carried: What carries the sensors, "phone" or "foot".
        own_attitude: Whether it is asked where a phone reports no rotation vector.
    """

    @property
    def carried(self) -> str: ...

    @property
    def own_attitude(self) -> bool: ...

    def ask(self, features: FloatArray, height_m: float, memory: Any) -> tuple[WindowAnswer, Any]:
        """What is said of one window (`CHANNELS`, `WINDOW`) after the memory of the second before, and its memory.

        `height_m` is that of the person, 0 where unknown; the first memory is None.
        """


@dataclass(frozen=True, slots=True)
class Move:
    """One second.

    Attributes:
        end_s: When it ended.
        move_m: (2,) in the frame of the rotation vector; of a foot, in that of the building if a heading is given.
        covariance_m2: (2, 2) of it.
        stands: Whether the network takes its bearer to stand.
        is_guess: True where samples were missing: their gait goes on, or else the last move, fading.
        doubt: 0 for input like that of training, towards 1 the further from it, of a network that says so.
        compass_rad: By how much the frame is turned to the mean of the compass so far from one that follows the
            gyroscope alone, in the middle of the second; None without a compass.
    """

    end_s: float
    move_m: FloatArray
    covariance_m2: FloatArray
    stands: bool
    is_guess: bool
    doubt: float = 0.0
    compass_rad: float | None = None


class Reckoner:
    """Takes the rows of a phone, or of a unit on a foot, and reports by how much its bearer moves.

    Of seconds of which samples are missing, networks are asked with signals whose gait goes on (`gaps_filled`); where
    too little came before, the displacement before goes on, fading.

    Args:
        network: In the state of being asked.
        briefing: Gives sensors and the height of the person.
        companions: Networks with whose displacements those of the first are averaged; one that cannot do with these
            sensors is left out, and one that contradicts the first for long counts for nothing.
        length_factor: On displacements.

    Raises:
        UnsuitableError: A sensor is missing or too slow, or the network is one for something carried elsewhere.
    """

    def __init__(
        self,
        network: WindowNetwork,
        briefing: Briefing,
        companions: Sequence[WindowNetwork] = (),
        *,
        length_factor: float = 1.0,
    ) -> None:
        self._length_factor, self._missing_s = length_factor, 0.0
        self._unknown_ends_s: list[float] = []  # of seconds before the first one that is known
        carrier = briefing.carrier
        if network.carried != carrier:
            raise UnsuitableError(f"these weights are for a {network.carried}, not for a {carrier}: leave them out")
        self._source = source = rows_of(briefing, network.own_attitude)
        briefing.require(sensors=source.sensors, min_rate_hz=source.min_rate_hz)
        has_rotation = "rotation" in source.sensors
        fit = [one for one in companions if one.carried == carrier and (one.own_attitude or has_rotation)]
        self._members = [_Member(one) for one in (network, *fit)]
        self._waiting: dict[str, list[FloatArray]] = {name: [] for name in source.sensors}
        self._newest_s = dict.fromkeys(source.sensors, -math.inf)
        self._rows: dict[str, FloatArray] = {name: np.zeros((0, 5 if name == "rotation" else 4)) for name in SENSORS}
        self._compass: FloatArray = np.zeros((0, 2))
        height_m = briefing.subject.get("height_m", 0.0)
        self._height_m = float(height_m) if isinstance(height_m, int | float) else 0.0
        self._checks = RowChecks("learned", self._rows) if carrier == PHONE else None
        self._held: list[Move] = []
        self._first_s: float | None = None
        self._last: Move | None = None

    @property
    def rise_m(self) -> float:
        """By how much a foot is higher than at the start; 0 of a phone."""
        return self._source.rise_m

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
        turn_rad = self._source.turn_rad
        if turn_rad is not None:
            for move in (_turned(one, turn_rad) for one in self._held):
                yield replace(move, move_m=self._length_factor * move.move_m)
            self._held = []

    def _seconds(self, rows: Mapping[str, FloatArray]) -> Iterator[Move]:
        """Those that are complete, in the frame of the rotation vector."""
        for name, waiting in self._waiting.items():
            is_finite = np.isfinite(rows[name])
            waiting.append(rows[name].copy() if is_finite.all() else rows[name][is_finite.all(axis=1)])
            if len(waiting[-1]):
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
        self._waiting = {name: [] for name in self._source.sensors}
        given = self._source.update(new)
        if self._checks is not None:
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

    def latest_change_m(self) -> tuple[float, FloatArray] | None:
        """Between two seconds: by how much more the second that ends with the newest samples says than the last one.

        By the last of several networks, which should be quick.

        Returns:
            since_s: How long after the last second it ends.
            change_m: (2,) its displacement less that of the last second; None where either is not known.
        """
        turn_rad = self._source.turn_rad
        if turn_rad is None or self._last is None or self._last.is_guess:
            return None
        self._take()
        end_s = min(float(rows[-1, 0]) for rows in self._rows.values())
        window, missing_s = self._seen(end_s)
        if window is None or missing_s:
            return None
        change_m = self._members[-1].trust * self._members[-1].change_m(*window, self._height_m)
        return end_s - self._last.end_s, self._length_factor * turned(change_m, turn_rad)

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
            faded = replace(self._last, end_s=end_s, move_m=FADES * self._last.move_m, doubt=0.0)
            move = _as_guess(faded, REPEATED_FRACTION)
        else:
            first, *others = [member.move(end_s, *window, self._height_m) for member in self._members]
            for member, other in zip(self._members[1:], others, strict=True):
                member.compare(first, other)
            move = mean_move([first, *others], [member.trust for member in self._members[1:]])
            if missing_s:
                move = _as_guess(move, GAP_FRACTION * self._missing_s)
        if len(self._compass):
            move = replace(move, compass_rad=float(np.interp(end_s - EVERY_S / 2, *self._compass.T)))
        self._last = move
        return move

    def _forget(self) -> None:
        for name, rows in self._rows.items():
            first = int(np.searchsorted(rows[:, 0], self._end_s - EVERY_S - KEPT_S))
            self._rows[name] = rows[min(first, max(len(rows) - 2, 0)) :]
        first = int(np.searchsorted(self._compass[:, 0], self._end_s - EVERY_S))
        self._compass = self._compass[min(first, max(len(self._compass) - 1, 0)) :]


class _Member:
    """A network, and what it remembers of a walk."""

    def __init__(self, network: WindowNetwork) -> None:
        self._network = network
        self._memory: Any = None
        self._rhythm, self._shaken, self._has_walked = 0.0, 0, False
        self._move_m, self._apart = np.zeros(2), 0.0

    @property
    def trust(self) -> float:
        """1 of a network that agrees with the first one as well as both claim, 0 where it has long contradicted it."""
        low, high = APART
        return min(max((high - self._apart) / (high - low), 0.0), 1.0)

    def compare(self, first: Move, own: Move) -> None:
        """Takes a second as the first network, and as this one, has it."""
        if not (first.stands and own.stands):
            off_m = own.move_m - first.move_m
            square = off_m @ np.linalg.solve(own.covariance_m2 + first.covariance_m2, off_m) / 2
            self._apart += (float(square) - self._apart) / APART_SECONDS

    def move(self, end_s: float, features: FloatArray, yaw_rad: float, height_m: float) -> Move:
        """The second that ends with a window."""
        said, self._memory = self._network.ask(features, height_m, self._memory)
        force = features[:3, -HORIZON:]
        shaking_mps2 = math.sqrt(np.sum((force - np.sum(force, axis=1, keepdims=True) / HORIZON) ** 2) / HORIZON)
        is_at_rest = self._network.carried == PHONE and shaking_mps2 < AT_REST_MPS2[self._has_walked]
        unrhythmic = 0.0 if is_at_rest else self._unrhythmic(said.rhythm)
        stands, doubt = said.standing > 0.0, unrhythmic
        if said.doubt is not None:  # its lengths are 0 of who stands, and a trolley may roll in ways never seen
            doubt = max(doubt, said.doubt)
            stands = stands and doubt < MAX_DOUBT and said.length_m < STANDS_M
        stands = stands or is_at_rest
        self._move_m = np.zeros(2) if stands else turned(said.move_m, yaw_rad)
        factor = turned(said.cholesky_m.T, yaw_rad).T
        covariance_m2 = factor @ factor.T
        if unrhythmic:
            covariance_m2 = covariance_m2 + np.eye(2) * (unrhythmic * STEPLESS_M) ** 2
        return Move(end_s, self._move_m, covariance_m2, stands, False, doubt)

    def change_m(self, features: FloatArray, yaw_rad: float, height_m: float) -> FloatArray:
        """(2,) by how much more a window says than that of the last second; it is not remembered."""
        said, _ = self._network.ask(features, height_m, self._memory)
        move_m = np.zeros(2) if said.standing > 0.0 else turned(said.move_m, yaw_rad)
        return move_m - self._move_m

    def _unrhythmic(self, peak: float) -> float:
        """0 while the phone shakes as steps do, 1 where it has long been shaken by something else."""
        if not math.isfinite(peak):
            return 0.0
        self._shaken = min(self._shaken + 1, RHYTHM_SECONDS)
        self._rhythm += (peak - self._rhythm) / self._shaken
        low, high = RHYTHMS
        self._has_walked |= self._shaken == RHYTHM_SECONDS and self._rhythm > high
        return min(max((high - self._rhythm) / (high - low), 0.0), 1.0)


def mean_move(moves: Sequence[Move], trust: Sequence[float]) -> Move:
    """One second as the mean of what networks say; the more the first doubts its input, the less the others count.

    The others count by their trust besides. The first normalises what shakes, so that it takes handling of a phone in
    the rhythm of steps for a walk: where another one takes the bearer to stand, the first counts the less in the mean
    the more that one does. The covariance is that of the mixture of all: they err alike, so it is not that of a mean.
    """
    first = moves[0]
    if len(moves) == 1:
        return first
    weight = np.array([1.0, *((1.0 - first.doubt) * one for one in trust)])
    stands = np.array([move.stands for move in moves])
    believed = weight.copy()
    if not stands[0]:
        believed[0] = np.prod(1.0 - weight[stands])
    move_m = np.array([move.move_m for move in moves])
    mean_m = believed @ move_m / believed.sum()
    off_m = move_m - mean_m
    covariances_m2 = np.array([move.covariance_m2 for move in moves]) + off_m[:, :, None] * off_m[:, None, :]
    return Move(
        first.end_s,
        mean_m,
        np.einsum("m,mij->ij", weight / weight.sum(), covariances_m2),
        stands=bool(stands.all()),
        is_guess=False,
        doubt=first.doubt,
    )


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
