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
from pdrbench_baselines.learned.attitude_sources import PHONE
from pdrbench_baselines.learned.constants import (
    CHANGE,
    CNN,
    CNN_INPUTS,
    CNN_LAYERS,
    DERIVED_SCALES,
    INPUTS,
    LOG_SIGMA,
    MEMORY,
    MIN_WEIGHT,
    NEAR_S,
    REST_MPS2,
    REST_RADPS,
    SCALES,
    USUAL_HEIGHT_M,
)
from pdrbench_baselines.learned.kernels import yaw_means
from pdrbench_baselines.learned.reckoning import WindowAnswer
from pdrbench_baselines.learned.signals import CHANNELS, HORIZON, RATE_HZ, WINDOW, grid_signals
from pdrbench_baselines.learned.weight_files import PACKAGED, TRAIN, check_form, packaged_file, read_arrays

_RESNET: Final = "resnet"
_NORM_EPSILON: Final = 1e-5  # of batch normalisation, as PyTorch
_STRIDES: Final = {3: 1, 4: 2, 5: 1, 6: 2, 7: 1}  # of residual blocks, by their place in the trunk
_BLOCKS: Final = len(_STRIDES)
_LINEAR: Final = (("neck.0", ""), ("memory", "_ih_l0"), ("memory", "_hh_l0"), ("head.0", ""), ("head.2", ""))
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
def _cnn_outputs(x: Any, parameters: Any, layers: Any) -> Any:
    """Outputs of inputs (`WINDOW` + 2 `_PADDING`, `CNN_INPUTS`): of the last vector beside the mean of all."""
    for i in range(CNN_LAYERS):
        x = _layer(x, parameters, layers[i], 0.0)
    both = np.concatenate((x[-2], np.sum(x, axis=0) / (len(x) - 2)))  # the first and the last row are zero
    hidden = _layer(both.reshape(1, -1), parameters, layers[CNN_LAYERS], 0.0)[1]
    return _layer(hidden.reshape(1, -1), parameters, layers[CNN_LAYERS + 1], -math.inf)[1]


@compiled
def _outputs(x: Any, change: Any, past: Any, parameters: Any, layers: Any) -> Any:
    """Outputs, and memory (`MEMORY`,), of inputs (`WINDOW` + 2 `_PADDING`, inputs), change and the memory before.

    Layers (n, 6) are in the order of use, of width 0 where none leads around a block.
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
    seen = _layer(channels.reshape(1, -1), parameters, layers[end + 1], 0.0)[1]
    gates = _layer(np.concatenate((seen, change)).reshape(1, -1), parameters, layers[end + 2], -math.inf)[1]
    past_gates, memory = _layer(past.reshape(1, -1), parameters, layers[end + 3], -math.inf)[1], np.empty(MEMORY)
    for m in range(MEMORY):
        reset = 1.0 / (1.0 + math.exp(-gates[m] - past_gates[m]))
        update = 1.0 / (1.0 + math.exp(-gates[MEMORY + m] - past_gates[MEMORY + m]))
        new = math.tanh(gates[2 * MEMORY + m] + reset * past_gates[2 * MEMORY + m])
        memory[m] = new + update * (past[m] - new)
    head = _layer(np.concatenate((seen, memory)).reshape(1, -1), parameters, layers[end + 4], 0.0)[1]
    return _layer(head.reshape(1, -1), parameters, layers[end + 5], -math.inf)[1], memory


@compiled
def _foot_inputs(window: Any, person: Any, rested_mps: Any, scales: Any, derived_scales: Any, weights: Any) -> Any:
    """Inputs of a window (`CHANNELS`, `WINDOW`), and its change, by velocities (2, `WINDOW`)."""
    turned_rad = np.cumsum(window[5]) / RATE_HZ
    turned_rad -= turned_rad.mean()
    change = _change(rested_mps, weights, turned_rad)
    x = np.zeros((WINDOW + 2 * _PADDING, INPUTS))
    for t in range(WINDOW):
        for i in range(CHANNELS):
            x[_PADDING + t, i] = window[i, t] / scales[i]
        for i in range(3):
            value = rested_mps[i, t] if i < 2 else turned_rad[t]
            x[_PADDING + t, CHANNELS + i] = value / derived_scales[i]
        x[_PADDING + t, -2], x[_PADDING + t, -1] = person
    return x, change


@compiled
def _change(rates: Any, weights: Any, yaw_rad: Any) -> Any:
    """(`CHANGE`,): sums of (2, T) weighed by (T,); the yaw (T,) 2 s ago, 1 s ago and now."""
    change = np.zeros(CHANGE)
    for t in range(len(weights)):
        change[0] += rates[0, t] * weights[t]
        change[1] += rates[1, t] * weights[t]
    for i in range(3):
        change[2 + i] = yaw_rad[WINDOW - 1 + (i - 2) * HORIZON]
    return change


class CompiledNetwork:
    """A network of a phone, of architecture "cnn", or of a foot, "resnet".

    Args:
        arrays: Its weights by name.
        form: What their file says of it.
        path: Of that file, for messages.

    Raises:
        DatasetError: An array is missing or has another shape, or the network has another form.
    """

    def __init__(self, arrays: Arrays, form: Mapping[str, Any], path: Path) -> None:
        self.carried = str(form.get("carried", PHONE))
        is_phone = self.carried == PHONE
        expected = CNN if is_phone else _RESNET
        if form.get("arch") != expected:
            raise DatasetError(f"{path}: {form.get('arch')!r} is no network of a {self.carried}; train with `{TRAIN}`")
        check_form(form, CNN_INPUTS if is_phone else INPUTS, path)
        try:
            self._take(arrays)
            self.ask(np.zeros((CHANNELS, WINDOW)), 0.0, None)  # fails where shapes do not fit
        except (KeyError, ValueError, IndexError, AssertionError) as error:
            raise DatasetError(
                f"{path}: these weights are of another network ({error}); train with `{TRAIN}`"
            ) from error

    def ask(self, features: FloatArray, height_m: float, memory: FloatArray | None) -> tuple[WindowAnswer, FloatArray]:
        """What is said of one window (`CHANNELS`, `WINDOW`) after the memory of the second before, and its memory."""
        window = np.ascontiguousarray(features)
        person = ((height_m - USUAL_HEIGHT_M[0]) / USUAL_HEIGHT_M[1], 1.0) if height_m > 0 else (0.0, 0.0)
        past = np.zeros(MEMORY) if memory is None else memory
        if self.carried == PHONE:
            x = np.zeros((WINDOW + 2 * _PADDING, CNN_INPUTS))
            x[_PADDING:-_PADDING, :CHANNELS] = window.T / self._scales
            x[_PADDING:-_PADDING, CHANNELS:] = person
            values = _cnn_outputs(x, self._parameters, self._layers)
            move_m = values[:2]
        else:
            x, change = _foot_inputs(window, person, self._rested(window), self._scales, self._derived, self._weights)
            values, past = _outputs(x, change, past, self._parameters, self._layers)
            move_m = values[:2] / (math.hypot(values[0], values[1]) + 1e-6) * float(np.logaddexp(0.0, values[6]))
        out, (low, high) = values.tolist(), LOG_SIGMA
        first, second = (self._claim * math.exp(min(max(out[i], low), high)) for i in (2, 4))
        cross = self._claim * min(max(out[3], -2.0), 2.0)
        return WindowAnswer(move_m, np.array([[first, 0.0], [cross, second]]), out[5]), past

    def _take(self, arrays: Arrays) -> None:
        """Puts arrays in place, with what normalisation does to them."""
        layers: list[tuple[int, ...]] = []
        parameters: list[FloatArray] = []

        def add(weight: FloatArray, bias: FloatArray, stride: int = 1, padding: int = 0) -> None:
            matrix = np.atleast_3d(weight).transpose(2, 1, 0)
            if bias.shape != matrix.shape[2:] or len(matrix) % 2 == 0:
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

        self._claim, self._scales = float(arrays["claim"][0]), np.array(SCALES[self.carried])
        if self.carried == PHONE:
            for place in range(CNN_LAYERS):
                normalised(f"layers.{place}.0", f"layers.{place}.1", 2, 1 if place else _PADDING)
            linear("mix")
            linear("head")
            self._layers, self._parameters = np.array(layers), np.concatenate(parameters).astype(np.float64)
            return
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
        self._derived, t_s = np.array(DERIVED_SCALES), np.arange(WINDOW) / RATE_HZ
        add(np.exp(-0.5 * ((t_s[:, None] - t_s) / NEAR_S) ** 2), np.zeros(WINDOW))
        self._weights = np.zeros(WINDOW)
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
