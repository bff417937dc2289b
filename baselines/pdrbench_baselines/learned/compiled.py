"""The networks in compiled code: a window in a fraction of a millisecond, without PyTorch.

A library for networks of any size takes 180 MB, and most of its time to call operations that take less: these networks
multiply a million times a window. Values are float64, and sums have one order on every processor.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
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
_BLOCKS: Final = len(_STRIDES)
_LINEAR: Final = (("neck.0", ""), ("memory", "_ih_l0"), ("memory", "_hh_l0"), ("head.0", ""), ("head.2", ""))
_STEPS: Final = slice(LAGS.index(STEP_LAGS[0]), LAGS.index(STEP_LAGS[1]) + 1)
_LAGS: Final = np.array(LAGS)
_PADDING: Final = 3  # rows of zeros before and after inputs, for the first layer; one around what other layers give

Arrays = Mapping[str, NDArray[Any]]


@compiled
def _layer(x: Any, parameters: Any, layer: Any, least: float) -> Any:
    """(count + 2, outside) convolution over time of (time + 2 padding, inside), `least` at least; padding is zero.

    A layer is (6,): width, inside, outside, samples from one output to the next, rows of padding, and where in the
    parameters its weights (width, inside, outside) begin, with its bias (outside,) behind them.
    """
    count = (len(x) - 2 * layer[4] + 2 * (layer[0] // 2) - layer[0]) // layer[3] + 1
    return _added(np.zeros((count + 2, layer[2])), x, parameters, layer, least)


@compiled
def _added(out: Any, x: Any, parameters: Any, layer: Any, least: float) -> Any:
    """The same, added to what stands in (count + 2, outside)."""
    width, inside, outside, stride, padding, begin = layer[0], layer[1], layer[2], layer[3], layer[4], layer[5]
    count, span, first = len(out) - 2, width * inside, padding - width // 2
    if x.shape[1] != inside or out.shape[1] != outside or first < 0 or first + (count - 1) * stride + width > len(x):
        raise ValueError("weights for other inputs")
    weight, bias = parameters[begin : begin + span * outside].reshape(span, outside), begin + span * outside
    flat, first, stride = x.ravel(), first * inside, stride * inside
    for t in range(count):
        for o in range(outside):
            out[t + 1, o] += parameters[bias + o]
    for j in range(0, span - 7, 8):  # eight products at a time: sums are loaded and stored an eighth as often
        for t in range(count):
            at = first + t * stride + j
            a, b, c, d = flat[at], flat[at + 1], flat[at + 2], flat[at + 3]
            e, f, g, h = flat[at + 4], flat[at + 5], flat[at + 6], flat[at + 7]
            for o in range(outside):
                one = (a * weight[j, o] + b * weight[j + 1, o]) + (c * weight[j + 2, o] + d * weight[j + 3, o])
                two = (e * weight[j + 4, o] + f * weight[j + 5, o]) + (g * weight[j + 6, o] + h * weight[j + 7, o])
                out[t + 1, o] += one + two
    for j in range(span - span % 8, span):
        for t in range(count):
            for o in range(outside):
                out[t + 1, o] += flat[first + t * stride + j] * weight[j, o]
    return np.maximum(out, least)


@compiled
def _outputs(x: Any, beside: Any, change: Any, past: Any, parameters: Any, layers: Any) -> Any:
    """Outputs, memory (`MEMORY`,), and, of a network with a gait, by how much features are unlike usual ones, squared.

    Of inputs (`WINDOW` + 2 `_PADDING`, inputs), of what joins the output of the trunk (of a gait), of what joins the
    features, and of the memory before; layers (n, 6) in the order of use, of width 0 where none leads around a block.
    """
    x, end = _layer(x, parameters, layers[0], 0.0), 1 + 3 * _BLOCKS
    for i in range(1, end, 3):
        inner = _layer(x, parameters, layers[i], 0.0)
        if layers[i + 2, 0]:
            x = _layer(x, parameters, layers[i + 2], -math.inf)
        x = _added(x, inner, parameters, layers[i + 1], 0.0)
    x = _layer(x, parameters, layers[end], 0.0)
    length = len(x) - 2
    channels = np.empty(length * x.shape[1])
    for at in range(len(channels)):
        channels[at] = x[1 + at % length, at // length]
    seen = _layer(np.concatenate((channels, beside)).reshape(1, -1), parameters, layers[end + 1], 0.0)[1]
    gates = _layer(np.concatenate((seen, change)).reshape(1, -1), parameters, layers[end + 2], -math.inf)[1]
    past_gates, memory = _layer(past.reshape(1, -1), parameters, layers[end + 3], -math.inf)[1], np.empty(MEMORY)
    for m in range(MEMORY):
        reset = 1.0 / (1.0 + math.exp(-gates[m] - past_gates[m]))
        update = 1.0 / (1.0 + math.exp(-gates[MEMORY + m] - past_gates[MEMORY + m]))
        new = math.tanh(gates[2 * MEMORY + m] + reset * past_gates[2 * MEMORY + m])
        memory[m] = new + update * (past[m] - new)
    head = _layer(np.concatenate((seen, memory)).reshape(1, -1), parameters, layers[end + 4], 0.0)[1]
    out, unlike = _layer(head.reshape(1, -1), parameters, layers[end + 5], -math.inf)[1], 0.0
    if len(beside):
        for value in _layer(seen.reshape(1, -1), parameters, layers[end + 6], -math.inf)[1]:
            unlike += value**2
    return out, memory, unlike


@compiled
def _plain_inputs(window: Any, person: Any, rested_mps: Any, scales: Any, derived_scales: Any, weights: Any) -> Any:
    """Inputs of a window (`CHANNELS`, `WINDOW`), and its change, by velocities (2, `WINDOW`) of a foot or (0, 0)."""
    derived = _integrals(window[0], window[1], window[5])
    change = _change(rested_mps if len(rested_mps) else window[:2], weights, derived[2])
    x = np.zeros((WINDOW + 2 * _PADDING, INPUTS))
    for t in range(WINDOW):
        for i in range(CHANNELS):
            x[_PADDING + t, i] = window[i, t] / scales[i]
        for i in range(3):
            value = rested_mps[i, t] if i < len(rested_mps) else derived[i, t]
            x[_PADDING + t, CHANNELS + i] = value / derived_scales[i]
        x[_PADDING + t, -2], x[_PADDING + t, -1] = person
    return x, change[:-1]


@compiled
def _gait_inputs(window: Any, kernel: Any, floor: Any, lags: Any, derived_scales: Any, weights: Any) -> Any:
    """Inputs of a window (`CHANNELS`, `WINDOW`), its change, (3, lags) autocorrelations, size of the shaking."""
    slow, size, x = _slow(window[:6], kernel), np.zeros(2), np.zeros((WINDOW + 2 * _PADDING, GAIT_INPUTS))
    normal = np.empty(slow.shape)
    for i in range(len(slow)):
        for t in range(WINDOW):
            normal[i, t] = window[i, t] - slow[i, t]
            size[i // 3] += normal[i, t] ** 2 / WINDOW
    integrals = _integrals(slow[0], slow[1], window[5])
    for i in range(len(slow)):
        spread = math.sqrt(size[i // 3] + floor[i // 3] ** 2)
        for t in range(WINDOW):
            normal[i, t] /= spread
            x[_PADDING + t, i] = 1.5 * normal[i, t]
    for i in range(2):
        size[i] /= size[i] + floor[i] ** 2
    for t in range(_PADDING, _PADDING + WINDOW):
        for i in range(3):
            x[t, 6 + i], x[t, 9 + i] = slow[3 + i, t - _PADDING], window[6 + i, t - _PADDING]
            x[t, 12 + i] = integrals[i, t - _PADDING] / derived_scales[i]
        x[t, 15], x[t, 16] = size
    return x, _change(window[:2], weights, integrals[2]), _rhythm(normal, lags), size[0]


@compiled
def _integrals(x: Any, y: Any, turn: Any) -> Any:
    """(3, T) integrals over time of (T,) each, less their means."""
    out, sums, means = np.zeros((3, len(x))), np.zeros(3), np.zeros((3, 1))
    for t in range(len(x)):
        for i, rate in enumerate((x[t], y[t], turn[t])):
            sums[i] += rate / RATE_HZ
            means[i, 0] += sums[i] / len(x)
            out[i, t] = sums[i]
    return out - means


@compiled
def _change(rates: Any, weights: Any, yaw_rad: Any) -> Any:
    """(`CHANGE` + 1,): sums of (2, T) weighed by (T,); the yaw (T,) 2 s ago, 1 s ago and now; 0."""
    change = np.zeros(CHANGE + 1)
    for t in range(len(weights)):
        change[0] += rates[0, t] * weights[t]
        change[1] += rates[1, t] * weights[t]
    for i in range(3):
        change[2 + i] = yaw_rad[WINDOW - 1 + (i - 2) * HORIZON]
    return change


@compiled
def _slow(rows: Any, kernel: Any) -> Any:
    """(C, T) means around each sample, weighed by a symmetric kernel; rows are reflected at both ends."""
    (channels, count), half = rows.shape, len(kernel) // 2
    padded, out = np.empty(count + 2 * half), np.empty(rows.shape)
    for i in range(channels):
        for t in range(count + 2 * half):
            at = abs(t - half)
            padded[t] = rows[i, min(at, 2 * (count - 1) - at)]
        mean = out[i]
        for t in range(count):
            mean[t] = kernel[half] * padded[t + half]
        for k in range(half):
            for t in range(count):
                mean[t] += kernel[k] * (padded[t + k] + padded[t + 2 * half - k])
    return out


@compiled
def _rhythm(normal: Any, lags: Any) -> Any:
    """(3, lags) autocorrelation of the vertical force, of all force and of all rates (6, T)."""
    count = normal.shape[1]
    auto = np.zeros((3, len(lags) + 1))
    for index in range(len(lags) + 1):
        lag = 0 if index == 0 else lags[index - 1]
        force, vertical, rates = 0.0, 0.0, 0.0
        for t in range(count - lag):
            now, then = normal[:, t], normal[:, t + lag]
            vertical += now[2] * then[2]
            force += now[0] * then[0] + now[1] * then[1] + now[2] * then[2]
            rates += now[3] * then[3] + now[4] * then[4] + now[5] * then[5]
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
        window, past = np.ascontiguousarray(features), np.zeros(MEMORY) if memory is None else memory
        taller_m, is_known = (height_m - USUAL_HEIGHT_M[0], 1.0) if height_m > 0 else (0.0, 0.0)
        person, beside, rhythm = (taller_m / USUAL_HEIGHT_M[1], is_known), np.zeros(0), math.nan
        if self._has_gait:
            x, change, found, size = _gait_inputs(window, self._kernel, FLOOR, _LAGS, self._derived, self._weights)
            change[-1], beside = taller_m, np.concatenate([found.ravel(), person])
            if size > SHAKES:
                rhythm = float(found[:, _STEPS].max())
        else:
            rested_mps = self._rested(window) if self.carried == FOOT else np.zeros((0, 0))
            x, change = _plain_inputs(window, person, rested_mps, self._scales, self._derived, self._weights)
        values, memory, unlike = _outputs(x, beside, change, past, self._parameters, self._layers)
        out = values.tolist()
        low, high = LOG_SIGMA
        first, second = (self._claim * math.exp(min(max(out[i], low), high)) for i in (2, 4))
        cross = self._claim * min(max(out[3], -2.0), 2.0)
        doubt = None
        if self._has_gait:
            far = max(unlike / self._near, 1.0)
            doubt = 1.0 - 1.0 / far
            steps_hz = MAX_STEPS_HZ / (1.0 + math.exp(-out[OUTPUTS]))
            factor = math.exp(MAX_LOG_FACTOR * math.tanh(out[6]) * (1.0 - doubt) * self._trust)
            length_m = steps_hz * _step_law_m(steps_hz, USUAL_HEIGHT_M[0] + taller_m) * factor
            first, cross, second = _widened(first, cross, second, far, DOUBT_M * doubt)
        else:
            length_m = float(np.logaddexp(0.0, out[6]))
        move_m = values[:2] / (math.hypot(out[0], out[1]) + 1e-6) * length_m
        return WindowAnswer(move_m, length_m, np.array([[first, 0.0], [cross, second]]), out[5], doubt, rhythm), memory

    def _take(self, arrays: Arrays) -> None:
        """Puts arrays in place, with what normalisation does to them."""
        layers: list[tuple[int, ...]] = []
        parameters: list[FloatArray] = []

        def add(weight: FloatArray, bias: FloatArray, stride: int = 1, padding: int = 0) -> None:
            matrix = np.atleast_3d(weight).transpose(2, 1, 0)
            if bias.shape != matrix.shape[2:]:
                raise ValueError(f"{len(bias)} values of bias for weights {matrix.shape}")
            layers.append((*matrix.shape, stride, padding, sum(map(len, parameters))))
            parameters.extend((matrix.ravel(), bias))

        def linear(name: str, suffix: str = "", stride: int = 1, padding: int = 0) -> None:
            add(arrays[f"{name}.weight{suffix}"], arrays[f"{name}.bias{suffix}"], stride, padding)

        def normalised(name: str, norm: str, stride: int = 1, padding: int = 1) -> None:
            spread = np.sqrt(arrays[f"{norm}.running_var"].astype(np.float64) + _NORM_EPSILON)
            factor = arrays[f"{norm}.weight"] / spread
            bias = arrays[f"{norm}.bias"] - arrays[f"{norm}.running_mean"] * factor
            add(arrays[f"{name}.weight"] * factor[:, None, None], bias, stride, padding)

        normalised("trunk.0", "trunk.1", 2, _PADDING)
        for place, stride in _STRIDES.items():
            name = f"trunk.{place}"
            normalised(f"{name}.body.0", f"{name}.body.1", stride)
            normalised(f"{name}.body.3", f"{name}.body.4")
            if f"{name}.way.weight" in arrays:
                linear(f"{name}.way", stride=stride, padding=1)
            else:
                layers.append((0,) * 6)
        linear("trunk.8", padding=1)
        for name, suffix in _LINEAR:
            linear(name, suffix)
        if {layers[-4][2], layers[-3][2]} != {3 * MEMORY}:
            raise ValueError("memory of another size")
        self._claim = float(arrays["claim"][0])
        rise = (np.arange(HORIZON) + 0.5) / HORIZON
        self._weights = np.zeros(WINDOW)
        self._weights[-2 * HORIZON :] = np.concatenate([rise, rise[::-1]]) / RATE_HZ
        self._scales, self._derived = np.array(SCALES[self.carried]), np.array(DERIVED_SCALES[self.carried])
        if self._has_gait:
            whitening = arrays["whitening"].T.astype(np.float64)
            add(whitening, np.zeros(FEATURES) - whitening @ arrays["usual_features"])
            self._trust, self._near = float(arrays["trust"][0]), float(arrays["near"][0])
            half = math.ceil(3 * SLOW_S * RATE_HZ)
            kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / (SLOW_S * RATE_HZ)) ** 2)
            self._kernel = kernel / kernel.sum()
        elif self.carried == FOOT:
            t_s = np.arange(WINDOW) / RATE_HZ
            add(np.exp(-0.5 * ((t_s[:, None] - t_s) / NEAR_S) ** 2), np.zeros(WINDOW))
            self._weights[:] = 0.0
            self._weights[-HORIZON:] = 1.0 / HORIZON
        self._layers, self._parameters = np.array(layers), np.concatenate(parameters).astype(np.float64)

    def _rested(self, window: FloatArray) -> FloatArray:
        """(2, `WINDOW`) velocity of a foot, m/s: its integrated acceleration less what that is where it rests."""
        force, rates = window[0:3] / REST_MPS2, window[3:6] / REST_RADPS
        weight = np.exp(-np.sum(force**2, axis=0) - np.sum(rates**2, axis=0)) + MIN_WEIGHT
        summed = np.cumsum(window[0:2], axis=1) / RATE_HZ
        x = np.concatenate([weight[None], weight * summed])
        near = _layer(x, self._parameters, self._layers[-1], -math.inf)
        rested_mps: FloatArray = summed - near[2:4] / near[1]
        return rested_mps


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
    for name in PACKAGED:
        compiled_network(name)  # asked once while it is made
    grid_signals(np.zeros((2, 4)), np.zeros((2, 4)), np.zeros((2, 5)), 0.0, 0.0)
    yaw_means(np.ones((2, 5)), np.zeros((2, 4)), 1.0, 1.0, 1.0, (0.0, 0.0, 0.0, 0.0))


def _step_law_m(steps_hz: float, height_m: float) -> float:
    """Usual length of a step at a step rate, of people of a height; 0.3 m at least."""
    usual_m, per_height, usual_height_m, per_hz, usual_hz = LAW_M
    taller_m = height_m - usual_height_m
    return max(usual_m + per_height * taller_m + per_hz * (steps_hz - usual_hz) * height_m / usual_height_m, 0.3)


def _widened(l11: float, l21: float, l22: float, far: float, added_m: float) -> tuple[float, float, float]:
    """Cholesky factor (l11, l21, l22) of a covariance times `far`, plus the square of `added_m` on the diagonal."""
    first = math.sqrt(far * l11**2 + added_m**2)
    lower = far * l11 * l21 / first
    return first, lower, math.sqrt(max(far * (l21**2 + l22**2) + added_m**2 - lower**2, 1e-8))
