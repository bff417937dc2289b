"""Strides of one foot, cut out of what the inertial filter knows at rests."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench.inertial.foot_filter import FootStates
from pdrbench.inertial.quaternions import twist_rad


@dataclass(frozen=True, slots=True)
class StrideParams:
    """Settings of the segmentation.

    Attributes:
        rest_sigma_mps: A foot whose velocity is known to be zero to within this rests.
        running_sigma_mps: Where no rest came for `running_s`, the slowest moment of a stretch within this counts as
            one, reported when the stretch is over: a running foot rolls on without a rest.
        running_s: See there; about as long as the swing of a walking foot.
        hold_s: A rest is reported once it has lasted for so long, or is over.
        moved_m: A foot that was set down nearer than this to where it stood made no stride.
        in_place_m: A shorter stride turns by the yaw of the foot, not by the direction of its displacement (W3).
        settle_s: The slowest moment of a stretch counts as a rest only where no rest comes within this: a foot that
            comes down after a slow swing is slow before it rests, and its stride would be cut in two.
        same_stance_s, same_stance_m: Two rests nearer than both are one: a foot rolls on while it stands.
    """

    rest_sigma_mps: float = 0.1
    running_sigma_mps: float = 2.0
    running_s: float = 0.6
    hold_s: float = 0.05
    moved_m: float = 0.02
    in_place_m: float = 0.1
    settle_s: float = 0.4
    same_stance_s: float = 0.35
    same_stance_m: float = 0.3


STRIDES: Final = StrideParams()


class Strides(NamedTuple):
    """Strides from rest to rest, in the world frame of the filter.

    Attributes:
        start_s: (S,) slowest moment of the rest before.
        end_s: (S,) slowest moment of the rest after.
        known_s: (S,) when the stride became known.
        length_m: (S,) horizontal.
        rise_m: (S,) change of height.
        turn_rad: (S,) change of the heading of travel since the stride before, 0 for the first; of a stride in place
            the change of yaw, by which its heading differs from the one before (W3).
        heading_rad: (S,) direction of the horizontal displacement.
        yaw_rad: (S,) of the foot at the end.
        yaw_turn_rad: (S,) change of yaw over the stride (F8).
        end_xyz_m: (S, 3) where the foot was set down.
        start_xyz_m: (S, 3) where it stood before.
    """

    start_s: FloatArray
    end_s: FloatArray
    known_s: FloatArray
    length_m: FloatArray
    rise_m: FloatArray
    turn_rad: FloatArray
    heading_rad: FloatArray
    yaw_rad: FloatArray
    yaw_turn_rad: FloatArray
    end_xyz_m: FloatArray
    start_xyz_m: FloatArray

    def rows(self) -> FloatArray:
        """(S, 4) as the sensor `stride` delivers them: time known, length, rise, turn."""
        return np.column_stack([self.known_s, self.length_m, self.rise_m, self.turn_rad])

    def steps(self, misalignment_rad: float = 0.0) -> FloatArray:
        """(S, 3) the step sensor of Frank et al. 2009, eq. (3)-(5): displacement in the heading before, change of yaw.

        Args:
            misalignment_rad: Heading of the pedestrian less that of the foot's yaw, counter-clockwise (F8).
        """
        before_rad = self.yaw_rad - self.yaw_turn_rad + misalignment_rad
        moved = (self.end_xyz_m - self.start_xyz_m)[:, :2]
        c, s = np.cos(before_rad), np.sin(before_rad)
        ahead, left = c * moved[:, 0] + s * moved[:, 1], -s * moved[:, 0] + c * moved[:, 1]
        return np.column_stack([ahead, left, self.yaw_turn_rad])


class StrideSegmenter:
    """Cuts a stream of states into strides, piece by piece.

    A rest is a stretch in which the velocity is known to be zero to within `rest_sigma_mps`; its moment is that of the
    smallest sigma. A stride is known `hold_s` after the rest at its end began, and nothing later is used; its end is
    then the best moment so far. The next stride begins where it ended: a foot creeps while it rests, and strides add up
    to the whole way.
    """

    def __init__(self, params: StrideParams = STRIDES) -> None:
        self._params = params
        self._stood: list[float] | None = None  # where the foot stood last
        self._rest: list[float] | None = None  # the best moment of the rest that goes on
        self._slowest: list[float] | None = None  # the best moment of a running foot's stance
        self._rest_s, self._rested_s = math.nan, -math.inf  # since when it goes on; when the foot rested last
        self._held: list[float] | None = None  # the best moment of a running foot's stance that may be no rest
        self._held_s = math.nan  # when that was over
        self._is_reported = False
        self._heading_rad, self._is_first = math.nan, True

    def update(self, states: FootStates) -> Strides:
        """The strides that are known after the next n states."""
        found: list[tuple[float, ...]] = []
        yaw_rad, sigma_mps = twist_rad(states.quaternion)[:, None], states.rest.sigma_mps[:, None]
        columns = [states.t_s[:, None], states.position_m, yaw_rad, sigma_mps]
        for row in np.concatenate(columns, axis=1).tolist():
            if not math.isnan(row[1]):
                self._take(row, found)
        fields = np.array(found).reshape(-1, 15).T
        return Strides._make([*fields[:9], fields[9:12].T.copy(), fields[12:15].T.copy()])

    def _take(self, row: list[float], found: list[tuple[float, ...]]) -> None:
        p, now_s, sigma = self._params, row[0], row[-1]
        if self._held is not None and now_s - self._held_s >= p.settle_s:
            self._report(self._held, now_s, found)
            self._held = None
        if sigma <= p.rest_sigma_mps:
            self._held = None
            self._slowest, self._rested_s = None, now_s
            if self._rest is None:
                self._rest, self._rest_s, self._is_reported = row, now_s, False
            elif not self._is_reported and sigma < self._rest[-1]:
                self._rest = row
            if not self._is_reported and now_s - self._rest_s >= p.hold_s:
                self._report(self._rest, now_s, found)
                self._is_reported = True
            return
        if self._rest is not None and not self._is_reported:
            self._report(self._rest, now_s, found)
        self._rest = None
        if sigma <= p.running_sigma_mps and now_s - self._rested_s >= p.running_s:
            if self._slowest is None or sigma < self._slowest[-1]:
                self._slowest = row
        elif self._slowest is not None:
            self._held, self._held_s = self._slowest, now_s
            self._slowest, self._rested_s = None, now_s
            if not p.settle_s:
                self._report(self._held, now_s, found)
                self._held = None

    def _report(self, rest: list[float], now_s: float, found: list[tuple[float, ...]]) -> None:
        """Adds the stride to a rest, if there was one."""
        stood = self._stood
        if stood is None:
            self._stood = rest
            return
        moved_x, moved_y, rise_m = (now - before for now, before in zip(rest[1:4], stood[1:4], strict=True))
        length_m = math.hypot(moved_x, moved_y)
        if math.hypot(length_m, rise_m) < self._params.moved_m:
            return
        if rest[0] - stood[0] < self._params.same_stance_s and length_m < self._params.same_stance_m:
            return
        yaw_turn_rad = float(wrap_rad(rest[4] - stood[4]))
        turn_rad = yaw_turn_rad
        if length_m >= self._params.in_place_m:
            heading_rad = math.atan2(moved_y, moved_x)
            turn_rad = 0.0 if self._is_first else float(wrap_rad(heading_rad - self._heading_rad))
            self._heading_rad, self._is_first = heading_rad, False
        elif self._is_first:
            turn_rad, heading_rad = 0.0, math.atan2(moved_y, moved_x)
        else:
            self._heading_rad = heading_rad = float(wrap_rad(self._heading_rad + yaw_turn_rad))
        stride = (stood[0], rest[0], now_s, length_m, rise_m, turn_rad, heading_rad, rest[4], yaw_turn_rad)
        found.append((*stride, *rest[1:4], *stood[1:4]))
        self._stood = rest


def find_strides(states: FootStates, params: StrideParams = STRIDES) -> Strides:
    """Strides of a whole recording, of the states that `navigate` gives; see `StrideSegmenter`.

    Args:
        states: Of the whole recording.
        params: See `StrideParams`.

    Raises:
        RecordingError: Something else than states is given, or no state is known.
    """
    if not isinstance(states, FootStates):
        raise RecordingError(f"strides are found in what navigate returns, FootStates; got {type(states).__name__}")
    if not np.isfinite(states.x[:, 0]).any():
        raise RecordingError("strides: no state is known, since the foot never rests; is the unit on a foot?")
    return StrideSegmenter(params).update(states)
