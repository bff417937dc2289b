"""The literal filter of a foot whose zero velocities a recurrent network detects, with weights of a training run.

Wagstaff, Kelly, LSTM-based zero-velocity detection for robust inertial navigation (IPIN 2018); Wagstaff, Peretroukhin,
Kelly (IEEE Sensors Journal 20(2), 2019). Only the detector differs from `foot_ins`.
"""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import LITERAL, FootFilter, FootParams, FootStates, Rest
from pdrbench.localizer import Briefing
from pdrbench_baselines.foot_ins.localizer import FOOT_INS, FootIns, FootInsParams
from pdrbench_lab.learned.threads import INSTALL, one_thread

if TYPE_CHECKING:
    from pdrbench_lab.learned.zero_velocity_network import ZeroVelocityNetwork

RATE_HZ: Final = 200.0  # of the recordings of the paper
CONFIDENCE: Final = 0.85  # of the network, above which the foot rests; as the authors


class LstmRestDetector:
    """Applies the network to a stream of any rate, piece by piece; its memory goes on from the first sample.

    The network gets samples at 200 Hz, interpolated linearly; a sample of the unit has the answer of the last of them.

    Args:
        network: In the state of being asked.
        sigma_mps: Standard deviation of the velocity of a foot that rests.
        confidence: Probability of rest above which the foot rests.
    """

    def __init__(
        self,
        network: ZeroVelocityNetwork,
        sigma_mps: float = LITERAL.detector.sigma_mps,
        confidence: float = CONFIDENCE,
    ) -> None:
        self._network, self._sigma_mps, self._confidence = network, sigma_mps, confidence
        self._memory: Any = None
        self._last: FloatArray = np.zeros((0, 7))  # time, force, rate of the last sample
        self._asked, self._probability = 0, 0.0  # samples at 200 Hz so far, and the answer to the last one
        self._first_s = 0.0

    def update(self, t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> Rest:
        """What is to be said of the next n samples.

        Args:
            t_s: (n,) seconds, following on those of the last call.
            accel: (n, 3) specific force, m/s2.
            gyro: (n, 3) rate, rad/s.
        """
        probability = self.probabilities(t_s, accel, gyro)
        sigma = np.where(probability > self._confidence, self._sigma_mps, np.inf)
        return Rest(sigma, np.full(len(t_s), np.inf), 1.0 - probability)

    def probabilities(self, t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> FloatArray:
        """(n,) of rest, for the same."""
        if not len(t_s):
            return np.zeros(0)
        rows = np.concatenate([self._last, np.column_stack([t_s, accel, gyro])])
        if not len(self._last):
            self._first_s = float(t_s[0])
        self._last = rows[-1:]
        count = int((t_s[-1] - self._first_s) * RATE_HZ + 1e-6) + 1 - self._asked
        at_s = self._first_s + (self._asked + np.arange(max(count, 0))) / RATE_HZ
        own = [self._probability]
        if len(at_s):
            even = np.column_stack([np.interp(at_s, rows[:, 0], one) for one in rows[:, 1:].T])
            with one_thread():
                said, self._memory = self._network.probabilities(even, self._memory)
            own += said.tolist()
        last = np.searchsorted(at_s, t_s + 1e-9, side="right")
        self._asked += len(at_s)
        self._probability = own[-1]
        answers: FloatArray = np.array(own)[last]
        return answers


class LstmFootFilter(FootFilter):
    """The filter of a foot with the zero velocities of the network."""

    def __init__(self, rate_hz: float, params: FootParams, detector: LstmRestDetector) -> None:
        super().__init__(rate_hz, params)
        self._lstm = detector

    def update(
        self,
        t_s: FloatArray,
        accel: FloatArray,
        gyro: FloatArray,
        field: FloatArray | None = None,
        rest: Rest | None = None,
    ) -> FootStates:
        """Takes the next n samples, see `FootFilter.update`."""
        return super().update(t_s, accel, gyro, field, self._lstm.update(t_s, accel, gyro) if rest is None else rest)


class FootInsLstm(FootIns):
    """`foot_ins` with the detector of the network; needs a unit on the foot, as that.

    Args:
        params: See `FootInsParams`.
        weights: Name of weights that come with pdrbench, or a file that `zero_velocity_train` wrote.
    """

    def __init__(self, params: FootInsParams = FOOT_INS, *, weights: str = "foot_ins_lstm") -> None:
        super().__init__(params)
        self._network = load_network(weights)

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        super().reset(briefing, rng)
        params = self._filter_params
        detector = LstmRestDetector(self._network, params.detector.sigma_mps)
        self._filter = LstmFootFilter(self._rate_hz, params, detector)


def load_network(weights: str) -> ZeroVelocityNetwork:
    """The network of a name or in a file; one that comes with pdrbench is known by its hash.

    Raises:
        UnsuitableError: torch or safetensors is not installed.
        DatasetError: The file is not what it should be.
    """
    reader = _reader()
    network: ZeroVelocityNetwork = (
        reader.packaged(weights) if weights in reader.PACKAGED else reader.restore(Path(weights))
    )
    return network


def _reader() -> ModuleType:
    """What reads weights, and needs torch."""
    try:
        import pdrbench_lab.learned.zero_velocity_network as network
    except ModuleNotFoundError as error:
        raise UnsuitableError(f"needs {error.name}: run `{INSTALL}`") from error
    return network
