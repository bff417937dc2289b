"""The networks in compiled code: a window in a fraction of a millisecond, without PyTorch.

A library for networks of any size takes 180 MB, and most of its time to call operations that take less: these networks
multiply a million times a window. Values are float64, and sums have one order on every processor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.compiled import compiled
from pdrbench.errors import DatasetError
from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.attitude_sources import FOOT, PHONE
from pdrbench_baselines.learned.constants import (
    CHANGE,
    DERIVED_SCALES,
    DOUBT_M,
    FEATURES,
    FLOOR,
    GAIT,
    GAIT_INPUTS,
    INPUTS,
    LAGS,
    LAW_M,
    LOG_SIGMA,
    MAX_LOG_FACTOR,
    MAX_STEPS_HZ,
    MEMORY,
    MIN_WEIGHT,
    NEAR_S,
    OUTPUTS,
    REST_MPS2,
    REST_RADPS,
    SCALES,
    SHAKES,
    STEP_LAGS,
    USUAL_HEIGHT_M,
)
from pdrbench_baselines.learned.kernels import yaw_means
from pdrbench_baselines.learned.reckoning import WindowAnswer
from pdrbench_baselines.learned.signals import CHANNELS, HORIZON, RATE_HZ, SLOW_S, WINDOW, grid_signals
from pdrbench_baselines.learned.weight_files import PACKAGED, TRAIN, check_form, packaged_file, read_arrays

_RESNET: Final = "resnet"
_NORM_EPSILON: Final = 1e-5  # of batch normalisation, as PyTorch
_STRIDES: Final = {3: 1, 4: 2, 5: 1, 6: 2, 7: 1}  # of residual blocks, by their place in the trunk
_STEPS: Final = np.array([i for i, lag in enumerate(LAGS) if STEP_LAGS[0] <= lag <= STEP_LAGS[1]])
_LAGS: Final = np.array(LAGS)

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """A convolution over time, with the normalisation that follows it; a linear layer is one of a single sample.

    Attributes:
        weight: (width, inside, outside).
        bias: (outside,).
        stride: Between samples of the output.
    """

    weight: FloatArray
    bias: FloatArray
    stride: int = 1

    def __call__(self, x: FloatArray, least: float = -math.inf) -> FloatArray:
        """(time, outside) of (time, inside), zero outside, `least` at least; or (outside,) of (inside,)."""
        if x.ndim == 1:
            sample: FloatArray = self(x[None], least)[0]
            return sample
        if x.shape[1] != self.weight.shape[1] or self.bias.shape != self.weight.shape[2:]:
            raise ValueError(f"{x.shape[1]} values for weights {self.weight.shape} and {len(self.bias)} of bias")
        return _convolved(x, self.weight, self.bias, self.stride, self.weight.shape[0] // 2, least)


@compiled
def _convolved(
    x: FloatArray, weight: FloatArray, bias: FloatArray, stride: int, padding: int, least: float
) -> FloatArray:
    width, inside, outside = weight.shape
    count = (len(x) + 2 * padding - width) // stride + 1
    out = np.empty((count, outside))
    for t in range(count):
        for o in range(outside):
            out[t, o] = bias[o]
    for k in range(width):
        first, end = max(-((k - padding) // stride), 0), min((len(x) + padding - k + stride - 1) // stride, count)
        for i in range(0, inside - 3, 4):  # four products at a time: sums are loaded and stored a quarter as often
            for t in range(first, end):
                at = t * stride + k - padding
                one, two, three, four = x[at, i], x[at, i + 1], x[at, i + 2], x[at, i + 3]
                for o in range(outside):
                    both = out[t, o] + one * weight[k, i, o] + two * weight[k, i + 1, o]
                    out[t, o] = both + three * weight[k, i + 2, o] + four * weight[k, i + 3, o]
        for i in range(inside - inside % 4, inside):
            for t in range(first, end):
                for o in range(outside):
                    out[t, o] += x[t * stride + k - padding, i] * weight[k, i, o]
    for t in range(count):
        for o in range(outside):
            out[t, o] = max(out[t, o], least)
    return out


@compiled
def _remembered(gates: FloatArray, past_gates: FloatArray, past: FloatArray) -> FloatArray:
    """(M,) state of a gated recurrent unit after gates (3 M,) of its input and of its state before (M,)."""
    size = len(past)
    state = np.empty(size)
    for m in range(size):
        reset = 1.0 / (1.0 + math.exp(-gates[m] - past_gates[m]))
        update = 1.0 / (1.0 + math.exp(-gates[size + m] - past_gates[size + m]))
        new = math.tanh(gates[2 * size + m] + reset * past_gates[2 * size + m])
        state[m] = new + update * (past[m] - new)
    return state


@compiled
def _slow(rows: FloatArray, kernel: FloatArray) -> FloatArray:
    """(T, C) weighted means around each sample; rows are reflected at both ends."""
    (count, columns), half = rows.shape, len(kernel) // 2
    padded, out = np.empty((count + 2 * half) * columns), np.zeros(count * columns)
    for t in range(count + 2 * half):
        at = abs(t - half)
        for i in range(columns):
            padded[t * columns + i] = rows[min(at, 2 * (count - 1) - at), i]
    for k in range(len(kernel)):
        for at in range(len(out)):
            out[at] += kernel[k] * padded[k * columns + at]
    return out.reshape(count, columns)


@compiled
def _rhythm(normal: FloatArray, lags: NDArray[np.int64]) -> FloatArray:
    """(3, lags) autocorrelation of the vertical force, of all force and of all rates (T, 6)."""
    count = len(normal)
    auto = np.zeros((3, len(lags) + 1))
    for index in range(len(lags) + 1):
        lag = 0 if index == 0 else lags[index - 1]
        force, vertical, rates = 0.0, 0.0, 0.0
        for t in range(count - lag):
            up = normal[t, 2] * normal[t + lag, 2]
            vertical += up
            force += normal[t, 0] * normal[t + lag, 0] + normal[t, 1] * normal[t + lag, 1] + up
            for i in range(3, 6):
                rates += normal[t, i] * normal[t + lag, i]
        auto[0, index], auto[1, index], auto[2, index] = vertical, force, rates
    return auto[:, 1:] / (auto[:, :1] + 1e-3 * count)


class CompiledNetwork:
    """A network of architecture "resnet", of a phone or a foot, or "gait".

    Args:
        arrays: Its weights by name.
        form: What their file says of it.
        path: Of that file, for messages.

    Raises:
        DatasetError: An array is missing or has another shape, or the network has another form.
    """

    def __init__(self, arrays: Arrays, form: Mapping[str, Any], path: Path) -> None:
        arch, self.carried = form.get("arch"), str(form.get("carried", PHONE))
        if arch not in (_RESNET, GAIT):
            raise DatasetError(f"{path}: {arch!r} is no network that is compiled; take {_RESNET} or {GAIT} (`{TRAIN}`)")
        self.own_attitude = self._has_gait = arch == GAIT
        check_form(form, GAIT_INPUTS if self._has_gait else INPUTS, path)
        try:
            self._take(arrays)
            self.ask(np.zeros((CHANNELS, WINDOW)), 0.0, None)  # fails where shapes do not fit
        except (KeyError, ValueError, IndexError, AssertionError) as error:
            raise DatasetError(
                f"{path}: these weights are of another network ({error}); train with `{TRAIN}`"
            ) from error

    def ask(self, features: FloatArray, height_m: float, memory: FloatArray | None) -> tuple[WindowAnswer, FloatArray]:
        """What is said of one window (`CHANNELS`, `WINDOW`) after the memory of the second before, and its memory."""
        window = np.ascontiguousarray(features.T)
        rested_mps = self._rested(window) if self.carried == FOOT else None
        seen, rhythm = self._gait(window, height_m) if self._has_gait else self._plain(window, height_m, rested_mps)
        change = self._change(window, height_m, rested_mps)
        past = np.zeros(MEMORY) if memory is None else memory
        memory = _remembered(self._into(np.concatenate([seen, change])), self._onto(past), past)
        out = self._out(self._head(np.concatenate([seen, memory]), 0.0))
        low, high = LOG_SIGMA
        first, second = np.exp(np.minimum(np.maximum(out[[2, 4]], low), high))
        cholesky_m = self._claim * np.array([[first, 0.0], [min(max(out[3], -2.0), 2.0), second]])
        doubt = None
        if self._has_gait:
            far = max(float(np.sum(self._whiten(seen - self._usual) ** 2)) / self._near, 1.0)
            doubt = 1.0 - 1.0 / far
            steps_hz = MAX_STEPS_HZ / (1.0 + math.exp(-out[OUTPUTS]))
            factor = math.exp(MAX_LOG_FACTOR * math.tanh(out[6]) * (1.0 - doubt) * self._trust)
            length_m = steps_hz * _step_law_m(steps_hz, USUAL_HEIGHT_M[0] + change[-1]) * factor
            cholesky_m = _widened(cholesky_m, far, DOUBT_M * doubt)
        else:
            length_m = float(np.logaddexp(0.0, out[6]))
        move_m = out[:2] / (math.hypot(*out[:2]) + 1e-6) * length_m
        return WindowAnswer(move_m, length_m, cholesky_m, float(out[5]), doubt, rhythm), memory

    def _take(self, arrays: Arrays) -> None:
        """Puts arrays in place, with what normalisation does to them."""

        def linear(name: str, bias: str = "bias", weight: str = "weight") -> Layer:
            matrix = arrays[f"{name}.{weight}"].astype(np.float64)
            width = matrix[..., None] if matrix.ndim == 2 else matrix
            return Layer(np.ascontiguousarray(width.transpose(2, 1, 0)), arrays[f"{name}.{bias}"].astype(np.float64))

        def normalised(name: str, norm: str, stride: int = 1) -> Layer:
            spread = np.sqrt(arrays[f"{norm}.running_var"].astype(np.float64) + _NORM_EPSILON)
            factor = arrays[f"{norm}.weight"] / spread
            weight = arrays[f"{name}.weight"] * factor[:, None, None]
            bias = arrays[f"{norm}.bias"] - arrays[f"{norm}.running_mean"] * factor
            return Layer(np.ascontiguousarray(weight.transpose(2, 1, 0)), bias, stride)

        self._begin = normalised("trunk.0", "trunk.1", 2)
        self._blocks: list[tuple[Layer, Layer, Layer | None]] = []
        for place, stride in _STRIDES.items():
            name, way = f"trunk.{place}", None
            if f"{name}.way.weight" in arrays:
                way = linear(f"{name}.way")
                way = Layer(way.weight, way.bias, stride)
            first = normalised(f"{name}.body.0", f"{name}.body.1", stride)
            self._blocks.append((first, normalised(f"{name}.body.3", f"{name}.body.4"), way))
        self._end, self._neck = linear("trunk.8"), linear("neck.0")
        self._into = linear("memory", "bias_ih_l0", "weight_ih_l0")
        self._onto = linear("memory", "bias_hh_l0", "weight_hh_l0")
        self._head, self._out = linear("head.0"), linear("head.2")
        if len(self._into.bias) != 3 * MEMORY or len(self._onto.bias) != 3 * MEMORY:
            raise ValueError("memory of another size")
        self._claim = float(arrays["claim"][0])
        if self._has_gait:
            whitening = arrays["whitening"].astype(np.float64)
            self._whiten = Layer(whitening[None], np.zeros(FEATURES))
            self._usual = arrays["usual_features"].astype(np.float64)
            self._trust, self._near = float(arrays["trust"][0]), float(arrays["near"][0])
            half = math.ceil(3 * SLOW_S * RATE_HZ)
            kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / (SLOW_S * RATE_HZ)) ** 2)
            self._kernel = kernel / kernel.sum()
        t_s = np.arange(WINDOW) / RATE_HZ
        self._nearness = np.exp(-0.5 * ((t_s[:, None] - t_s) / NEAR_S) ** 2)[None]
        rise = (np.arange(HORIZON) + 0.5) / HORIZON
        self._rise_and_fall = np.concatenate([rise, rise[::-1]]) / RATE_HZ

    def _trunk(self, x: FloatArray) -> FloatArray:
        """(features,) of (`WINDOW`, inputs), channel by channel."""
        x = self._begin(x, 0.0)
        for first, second, way in self._blocks:
            x = np.maximum(second(first(x, 0.0)) + (x if way is None else way(x)), 0.0)
        return self._end(x, 0.0).T.ravel()

    def _plain(self, window: FloatArray, height_m: float, rested_mps: FloatArray | None) -> tuple[FloatArray, float]:
        """(`FEATURES`,) of a window (`WINDOW`, channels); such a network does not look at the rhythm of steps."""
        summed = np.cumsum(window[:, [0, 1, 5]], axis=0) / RATE_HZ
        derived = summed - summed.mean(axis=0)
        if rested_mps is not None:
            derived = np.column_stack([rested_mps, derived[:, 2]])
        x = np.empty((WINDOW, INPUTS))
        x[:, :CHANNELS], x[:, CHANNELS:-2] = window / SCALES[self.carried], derived / DERIVED_SCALES[self.carried]
        x[:, -2:] = _person(height_m)
        return self._neck(self._trunk(x), 0.0), math.nan

    def _gait(self, window: FloatArray, height_m: float) -> tuple[FloatArray, float]:
        """(`FEATURES`,) of a window (`WINDOW`, channels), and how rhythmically it is shaken."""
        rows = np.ascontiguousarray(window[:, :6])
        slow = _slow(rows, self._kernel)
        shaking = rows - slow
        size2 = np.array([np.mean(np.sum(shaking[:, i : i + 3] ** 2, axis=1)) for i in (0, 3)])
        spread2 = size2 + np.square(FLOOR)
        normal = shaking / np.repeat(np.sqrt(spread2), 3)
        size = size2 / spread2
        integrals = np.cumsum(np.column_stack([slow[:, 0:2], window[:, 5]]), axis=0) / RATE_HZ
        integrals = (integrals - integrals.mean(axis=0)) / DERIVED_SCALES[self.carried]
        x = np.empty((WINDOW, GAIT_INPUTS))
        x[:, :6], x[:, 6:9], x[:, 9:12] = 1.5 * normal, slow[:, 3:6], window[:, 6:9]
        x[:, 12:15], x[:, 15:] = integrals, size
        rhythm = _rhythm(normal, _LAGS)
        seen = self._neck(np.concatenate([self._trunk(x), rhythm.ravel(), _person(height_m)]), 0.0)
        return seen, float(rhythm[:, _STEPS].max()) if size[0] > SHAKES else math.nan

    def _change(self, window: FloatArray, height_m: float, rested_mps: FloatArray | None) -> FloatArray:
        """(`CHANGE`,) of a window, and of a network with a gait by how much the person is taller than usual."""
        if rested_mps is not None:
            velocity_mps = rested_mps[-HORIZON:].mean(axis=0)
        else:
            weights = self._rise_and_fall[:, None]
            velocity_mps = np.sum(window[-len(weights) :, 0:2] * weights, axis=0)
        yaw_rad = np.cumsum(window[:, 5]) / RATE_HZ
        yaw_rad -= yaw_rad.mean()
        change = np.concatenate([velocity_mps, yaw_rad[[-2 * HORIZON - 1, -HORIZON - 1, -1]]])
        assert len(change) == CHANGE
        return np.append(change, _taller_m(height_m)) if self._has_gait else change

    def _rested(self, window: FloatArray) -> FloatArray:
        """(`WINDOW`, 2) velocity of a foot, m/s: its integrated acceleration less what that is where it rests."""
        force, rates = window[:, 0:3] / REST_MPS2, window[:, 3:6] / REST_RADPS
        weight = np.exp(-np.sum(force**2, axis=1) - np.sum(rates**2, axis=1)) + MIN_WEIGHT
        summed = np.cumsum(window[:, 0:2], axis=0) / RATE_HZ
        near = Layer(self._nearness, np.zeros(WINDOW))
        return summed - np.array([near(weight * one) for one in summed.T]).T / near(weight)[:, None]


def compiled_network(weights: str) -> CompiledNetwork:
    """The network of a name in `PACKAGED`, known by its hash, or in a file.

    Raises:
        DatasetError: The file is not what it should be.
    """
    is_packaged = weights in PACKAGED
    path = packaged_file(weights) if is_packaged else Path(weights)
    return CompiledNetwork(*read_arrays(path, PACKAGED[weights] if is_packaged else None), path)


def warm_up() -> None:
    """Compiles."""
    compiled_network("phone")  # asked once while it is made
    grid_signals(np.zeros((2, 4)), np.zeros((2, 4)), np.zeros((2, 5)), 0.0, 0.0)
    yaw_means(np.ones((2, 5)), np.zeros((2, 4)), 1.0, 1.0, 1.0, (0.0, 0.0, 0.0, 0.0))


def _taller_m(height_m: float) -> float:
    return height_m - USUAL_HEIGHT_M[0] if height_m > 0 else 0.0


def _person(height_m: float) -> FloatArray:
    """(2,) height over the usual one in its spreads, and whether it is known."""
    return np.array([_taller_m(height_m) / USUAL_HEIGHT_M[1], float(height_m > 0)])


def _step_law_m(steps_hz: float, height_m: float) -> float:
    """Usual length of a step at a step rate, of people of a height; 0.3 m at least."""
    usual_m, per_height, usual_height_m, per_hz, usual_hz = LAW_M
    taller_m = height_m - usual_height_m
    return max(usual_m + per_height * taller_m + per_hz * (steps_hz - usual_hz) * height_m / usual_height_m, 0.3)


def _widened(cholesky_m: FloatArray, far: float, added_m: float) -> FloatArray:
    """(2, 2) Cholesky factor of the covariance times `far`, plus the square of `added_m` on the diagonal."""
    (l11, _), (l21, l22) = cholesky_m
    first = math.sqrt(far * l11**2 + added_m**2)
    lower = far * l11 * l21 / first
    second = math.sqrt(max(far * (l21**2 + l22**2) + added_m**2 - lower**2, 1e-8))
    return np.array([[first, 0.0], [lower, second]])
