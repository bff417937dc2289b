"""Records, arrays and random states as MessagePack, and back: what comes out is the same to the last bit.

Nothing is pickled: a decoder builds the declared type and nothing else. Records travel as maps of their fields and come
back through their constructors; an array travels as its type, its shape and its raw little-endian bytes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import PdrbenchError


class ArrayMessage(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True):
    """An array as its raw bytes."""

    dtype: Literal["<f8", "<i8", "|b1"]
    shape: tuple[int, ...]
    data: bytes


class RngState(msgspec.Struct, array_like=True, frozen=True):
    """A PCG64 generator of random numbers: its state and its seed sequence as JSON."""

    state: str
    seeds: str


def encoder() -> msgspec.msgpack.Encoder:
    """Encodes messages that hold records and arrays."""
    return msgspec.msgpack.Encoder(enc_hook=_plain)


def decoder(kind: Any) -> msgspec.msgpack.Decoder[Any]:
    """Decodes messages of a kind; raises `msgspec.MsgspecError` where the bytes are none."""
    return msgspec.msgpack.Decoder(kind, dec_hook=_array)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        dtype: Any = value.dtype.newbyteorder("<").str
        return ArrayMessage(dtype, value.shape, np.ascontiguousarray(value).tobytes())
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    raise NotImplementedError(f"no message holds a {type(value).__name__}")


def _array(_: Any, value: Any) -> NDArray[Any]:
    """The array in a message, read-only; raises `ValueError` where shape and bytes disagree."""
    message = msgspec.convert(value, ArrayMessage)
    dtype = np.dtype(message.dtype)
    if min(message.shape, default=0) < 0 or math.prod(message.shape) * dtype.itemsize != len(message.data):
        raise ValueError(f"an array of shape {message.shape} came with {len(message.data)} bytes")
    return np.frombuffer(message.data, dtype).reshape(message.shape)


def pack_generator(rng: np.random.Generator) -> RngState:
    """The generator with its state, and with the seeds that its children would be spawned from.

    Raises:
        PdrbenchError: `numpy.random.default_rng` makes no such generator.
    """
    bits = rng.bit_generator
    seeds = bits.seed_seq
    if not isinstance(bits, np.random.PCG64) or not isinstance(seeds, np.random.SeedSequence):
        raise PdrbenchError(f"a localizer is given a generator of numpy.random.default_rng; got {bits!r}")
    return RngState(json.dumps(bits.state), json.dumps(seeds.state, default=lambda words: words.tolist()))


def unpack_generator(message: RngState) -> np.random.Generator:
    """The generator in a message."""
    bits = np.random.PCG64(np.random.SeedSequence(**json.loads(message.seeds)))
    bits.state = json.loads(message.state)
    return np.random.Generator(bits)
