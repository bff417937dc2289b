"""RoNIN and TLIO: dead reckoning by published networks; weights of the first come with the laboratory."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from pdrbench.errors import PdrbenchError, UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_baselines.learned.signals import turned
from pdrbench_lab.learned.odometry.aligned import LENGTH, RATE_HZ
from pdrbench_lab.learned.odometry.cloning_filter import CloningFilter, CloningParams, rotation_matrix
from pdrbench_lab.learned.odometry.stream import PhoneStream
from pdrbench_lab.learned.threads import INSTALL, one_thread

if TYPE_CHECKING:
    from torch import nn

START_SIGMA_M: Final = 0.3  # where the briefing gives no radius
WALKS_MPS: Final = 0.2  # below it the heading of travel stays
FADES: Final = 0.5  # of a velocity for every second without samples, as `learned`


@dataclass(frozen=True, slots=True)
class RoninParams:
    """Settings of `ronin`; ours unless a line says otherwise.

    Attributes:
        weights: Name of weights that come with the laboratory, or a file.
        every: Samples at 200 Hz between windows; 10 in the paper, which costs four times as much.
        speed_sigma_m: Error of the displacement, per root second, for `sigma_m`: of other simulated people.
        scale_sigma, heading_sigma_rad: Of the whole way, as `learned`.
    """

    weights: str = "ronin"
    every: int = 40
    speed_sigma_m: float = 0.3
    scale_sigma: float = 0.05
    heading_sigma_rad: float = math.radians(14.0)


@dataclass(frozen=True, slots=True)
class TlioParams:
    """Settings of `Tlio`; ours unless a line says otherwise.

    Attributes:
        weights: File of weights, of one's own training or converted.
        every: Samples at 200 Hz between displacements; 10 in the paper, see `CloningParams.overlap`.
        scale_sigma, heading_sigma_rad: Of the whole way, beside the covariance of the filter, as `learned`.
        height_sigma_m: Added to that of the height of a displacement, which the network learned to be 0.
        filter: See `CloningParams`.
    """

    weights: str
    every: int = 40
    scale_sigma: float = 0.05
    heading_sigma_rad: float = math.radians(14.0)
    height_sigma_m: float = 0.1
    filter: CloningParams = field(default_factory=CloningParams)


RONIN: Final = RoninParams()


class Tracker(Protocol):
    """What makes a way of the samples of one walk, in the frame of the stream."""

    def follow(self, count: int) -> None:
        """Takes the next `count` samples."""

    def state(self) -> tuple[FloatArray, FloatArray, float]:
        """Way since the start (2,), velocity (2,), and the variance per axis of the way in m2."""


class Odometry:
    """A network asked of windows of one second, and a tracker that makes a way of its answers, from a known start.

    Needs a phone's accelerometer and gyroscope at 20 Hz or more, and a rotation vector, a magnetometer or the heading
    of the start.

    Args:
        params: `RoninParams` or `TlioParams`.
        tracker: Makes the tracker of a walk of its network and its stream.
    """

    def __init__(self, params: RoninParams | TlioParams, tracker: Callable[[nn.Module, PhoneStream], Tracker]) -> None:
        if params.every <= 0 or LENGTH % params.every:
            raise PdrbenchError(f"every: {params.every}; a divisor of the {LENGTH} samples of a window is expected")
        _reader()  # imports torch now rather than on the first walk, or raises what is missing
        self._params, self._make_tracker = params, tracker
        self._share2 = (params.scale_sigma**2 + params.heading_sigma_rad**2) / 2
        self._network: nn.Module | None = None

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(start=True)
        assert briefing.start is not None
        self._stream = PhoneStream(briefing)
        if self._network is None:
            self._network = load_network(self._params.weights)
        self._tracker = self._make_tracker(self._network, self._stream)
        start = briefing.start
        self._start_m, self._level = np.array(start.xy_m), start.level
        self._start_sigma_m = max(start.radius_m / 2, START_SIGMA_M)
        self._heading_rad = start.heading_rad
        self._has_level_changes = "level_change" in briefing.sensors

    def step(self, observation: Observation) -> Estimate:
        self._stream.update(observation.rows)
        count = self._stream.ready(self._params.every)
        if count:
            with one_thread():
                self._tracker.follow(count)
        if self._has_level_changes:
            self._level += int(observation["level_change"][:, 1].sum())
        turn_rad = self._stream.turn_rad
        way_m, speed_mps, variance_m2 = self._tracker.state()
        if np.hypot(*speed_mps) > WALKS_MPS:
            self._heading_rad = math.atan2(speed_mps[1], speed_mps[0]) + turn_rad
        away_m2 = self._share2 * float(way_m @ way_m)
        return Estimate(
            xy_m=self._start_m + turned(way_m, turn_rad),
            level=self._level,
            heading_rad=self._heading_rad,
            sigma_m=math.sqrt(self._start_sigma_m**2 + variance_m2 + away_m2),
        )


class Ronin(Odometry):
    """Adds up the mean velocities that RoNIN's network gives.

    Args:
        params: See `RoninParams`.
    """

    def __init__(self, params: RoninParams = RONIN) -> None:
        super().__init__(params, lambda network, stream: RoninTracker(params, network, stream))


class Tlio(Odometry):
    """An error-state filter with the displacements, and their covariance, that TLIO's network gives.

    The rotation vector gives the attitude at the start and, once a second, a yaw.

    Args:
        params: See `TlioParams`.
    """

    def __init__(self, params: TlioParams) -> None:
        super().__init__(params, lambda network, stream: TlioTracker(params, network, stream))


class RoninTracker:
    """The sum of velocities, each for the time since the window before."""

    def __init__(self, params: RoninParams, network: nn.Module, stream: PhoneStream) -> None:
        self._params, self._network, self._stream = params, network, stream
        self._way_m, self._speed_mps, self._since_s, self._is_known = np.zeros(2), np.zeros(2), 0.0, False

    def follow(self, count: int) -> None:
        every = self._params.every
        samples = self._stream.take(count, LENGTH)
        ends = np.arange(len(samples) - count + every, len(samples) + 1, every)
        asked = [end for end in ends.tolist() if end >= LENGTH and samples.is_whole[end - LENGTH : end].all()]
        speeds_mps = dict(zip(asked, velocities(self._network, samples.rows, asked), strict=True))
        step_s = every / RATE_HZ
        for end in ends.tolist():
            if end in speeds_mps:
                self._speed_mps = speeds_mps[end]
                # The first window is the whole way of the first second.
                step_m = self._speed_mps * (step_s if self._is_known else LENGTH / RATE_HZ)
                self._is_known = True
            else:
                self._speed_mps = self._speed_mps * FADES**step_s
                step_m = self._speed_mps * step_s
            self._way_m = self._way_m + step_m
            self._since_s += step_s

    def state(self) -> tuple[FloatArray, FloatArray, float]:
        return self._way_m, self._speed_mps, self._params.speed_sigma_m**2 * self._since_s


class TlioTracker:
    """The filter of `cloning_filter`, asked for displacements by windows that it turns itself."""

    def __init__(self, params: TlioParams, network: nn.Module, stream: PhoneStream) -> None:
        self._params, self._network, self._stream = params, network, stream
        self._filter: CloningFilter | None = None
        self._window = np.zeros((0, 6))
        self._yaw_due_s = 0.0

    def follow(self, count: int) -> None:
        every = self._params.every
        samples = self._stream.take(count, in_body=True)
        if self._filter is None:
            first = rotation_matrix(self._stream.attitude(samples.first_s))
            self._filter = CloningFilter(first, self._params.filter)
            self._filter.clone()
        for begin in range(0, count, every):
            rows = slice(begin, begin + every)
            end_s = samples.first_s + (begin + every) / RATE_HZ
            if samples.is_whole[rows].all():
                self._advance(self._filter, samples.rows[rows], end_s)
            else:
                self._skip(self._filter, end_s)

    def state(self) -> tuple[FloatArray, FloatArray, float]:
        if self._filter is None:
            return np.zeros(2), np.zeros(2), 0.0
        variance_m2 = float(np.trace(self._filter.current_cov[6:8, 6:8])) / 2
        return self._filter.place_m[:2], self._filter.speed_mps[:2], variance_m2

    def _advance(self, tracker: CloningFilter, rows: FloatArray, end_s: float) -> None:
        """One displacement on: `every` samples in the frame of the phone."""
        world = tracker.propagate(rows[:, :3], rows[:, 3:], 1.0 / RATE_HZ)
        self._window = np.concatenate([self._window, world])[-LENGTH:]
        tracker.clone()
        if len(self._window) == LENGTH:
            move_m, covariance_m2 = displacement(self._network, self._window)
            covariance_m2[2, 2] += self._params.height_sigma_m**2
            tracker.measure_move(move_m, covariance_m2)
            tracker.forget(1)
        if end_s >= self._yaw_due_s:
            attitude = rotation_matrix(self._stream.attitude(end_s))
            tracker.measure_yaw(math.atan2(attitude[1, 0] - attitude[0, 1], attitude[0, 0] + attitude[1, 1]))
            self._yaw_due_s = end_s + 1.0

    def _skip(self, tracker: CloningFilter, end_s: float) -> None:
        """Samples are missing: the attitude is that of the phone afterwards, the window begins anew."""
        tracker.coast(self._params.every / RATE_HZ)
        tracker.rotation = rotation_matrix(self._stream.attitude(end_s))
        self._window = self._window[:0]
        tracker.forget(len(tracker.clones_m))
        tracker.clone()


def velocities(network: nn.Module, rows: FloatArray, ends: list[int]) -> FloatArray:
    """(N, 2) mean velocities over the windows of rows (n, 6) that end with samples `ends` (not in them)."""
    import torch

    if not ends:
        return np.zeros((0, 2))
    windows = np.stack([rows[end - LENGTH : end].T for end in ends]).astype(np.float32)
    with torch.inference_mode():
        out: FloatArray = network(torch.from_numpy(windows)).numpy().astype(np.float64)
    return out


def displacement(network: nn.Module, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The displacement (3,) over a window (200, 6) of a network with a covariance, and that (3, 3)."""
    import torch

    with torch.inference_mode():
        said = network(torch.from_numpy(np.ascontiguousarray(rows.T, dtype=np.float32))[None])
        move_m, log_sigma = (one[0].numpy().astype(np.float64) for one in said)
    return move_m, np.diag(np.exp(2.0 * log_sigma))


def load_network(weights: str) -> nn.Module:
    """The network of a name or in a file; one that comes with the laboratory is known by its hash.

    Raises:
        UnsuitableError: torch or safetensors is not installed.
        DatasetError: The file is not what it should be.
    """
    reader = _reader()
    from pdrbench_lab.learned.odometry.inference import for_inference

    return for_inference(reader.packaged(weights) if weights in reader.PACKAGED else reader.restore(Path(weights)))


def _reader() -> ModuleType:
    """What reads weights, and needs torch."""
    try:
        import pdrbench_lab.learned.odometry.weights as weights
    except ModuleNotFoundError as error:
        raise UnsuitableError(f"needs {error.name}: run `{INSTALL}`") from error
    return weights
