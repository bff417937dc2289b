"""Weights as safetensors: with their architecture, in 32 bits, or in 8 with a scale for every output channel."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Final

import torch
from safetensors.torch import save
from torch import Tensor, nn

from pdrbench.errors import DatasetError, unknown_name
from pdrbench_lab.learned.odometry.aligned import LENGTH, RATE_HZ
from pdrbench_lab.learned.odometry.resnet import DROPOUT, RONIN, TLIO, Ronin, Tlio
from pdrbench_lab.learned.weights import read

ARCHITECTURES: Final = {RONIN: Ronin, TLIO: Tlio}
# sha256 of the weights that come with the laboratory, by name
PACKAGED: Final[dict[str, str]] = {RONIN: "0a52c50fef8aaaf88392ccbb9ae1ba6efcdf3cc58ebf6f4d16a585440a93fbc1"}
TRAIN: Final = "python -m pdrbench_lab.learned odometry"
_FORM: Final = {"window": LENGTH, "rate_hz": RATE_HZ}
_SCALE: Final = "#scale"
_PACKED_FROM: Final = 4096  # values of a tensor; smaller ones stay as they are
_STEPS: Final = 127.0


def network_of(arch: str, dropout: float = DROPOUT) -> nn.Module:
    """A new network of an architecture.

    Raises:
        UnknownNameError: There is none of that name.
    """
    if arch not in ARCHITECTURES:
        raise unknown_name("architecture", arch, ARCHITECTURES)
    return ARCHITECTURES[arch](dropout)


def store(network: nn.Module, path: Path, *, packed: bool = False) -> str:
    """Writes a network; returns the sha256 of the file.

    Args:
        network: One of `ARCHITECTURES`.
        path: Of the file.
        packed: In 8 bits.
    """
    tensors = {
        name: values.detach().cpu().contiguous()
        for name, values in network.state_dict().items()
        if not name.endswith("num_batches_tracked")
    }
    content = save(_packed(tensors) if packed else tensors, metadata={"network": _form(str(network.arch))})
    path.write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def packaged(name: str) -> nn.Module:
    """One of the networks in `PACKAGED`, known by its hash."""
    return restore(Path(__file__).parents[1] / f"{name}.safetensors", PACKAGED[name])


def restore(path: Path, sha256: str | None = None, arch: str | None = None) -> nn.Module:
    """A network as it was stored, ready to be asked.

    Args:
        path: Of the file.
        sha256: It has to have; None for any.
        arch: Of a file that does not say so, as one that was converted from a published checkpoint.

    Raises:
        DatasetError: No such file, another hash, another form, or not safetensors at all.
    """
    tensors, form = read(path, sha256, train=TRAIN)
    form = form or {"arch": arch, **_FORM}
    if form.get("arch") not in ARCHITECTURES or any(form.get(name) != value for name, value in _FORM.items()):
        raise DatasetError(f"{path}: made for {form}, expected one of {', '.join(ARCHITECTURES)} with {_FORM}")
    with torch.random.fork_rng(devices=[]):  # a new network draws weights, which are overwritten at once
        network = network_of(str(form["arch"]))
    load_into(network, _unpacked(tensors), path)
    return network.eval()


def load_into(network: nn.Module, tensors: dict[str, Tensor], path: Path) -> None:
    """Puts tensors in place.

    Raises:
        DatasetError: A name or a shape that the network does not have, or lacks.
    """
    own = network.state_dict()
    counts = {name: values for name, values in own.items() if name.endswith("num_batches_tracked")}
    try:
        network.load_state_dict(counts | tensors)
    except RuntimeError as error:
        if "state_dict" not in str(error):
            raise  # PyTorch itself fails, as where a confined process cannot start it
        what = str(error).splitlines()[-1].strip()
        raise DatasetError(f"{path}: these weights are of another network ({what}); train with `{TRAIN}`") from error


def _form(arch: str) -> str:
    return json.dumps({"arch": arch, **_FORM}, sort_keys=True)


def _packed(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Large tensors in steps of a 127th of the largest value of each output channel."""
    out: dict[str, Tensor] = {}
    for name, values in tensors.items():
        if values.ndim < 2 or values.numel() < _PACKED_FROM:
            out[name] = values
            continue
        scale = values.flatten(1).abs().amax(dim=1).clamp(min=1e-12) / _STEPS
        out[name] = (values / _as_column(scale, values.ndim)).round().to(torch.int8)
        out[name + _SCALE] = scale
    return out


def _unpacked(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    plain = {name: values for name, values in tensors.items() if not name.endswith(_SCALE)}
    return {
        name: values.float() * _as_column(tensors[name + _SCALE], values.ndim) if name + _SCALE in tensors else values
        for name, values in plain.items()
    }


def _as_column(scale: Tensor, ndim: int) -> Tensor:
    return scale.reshape(-1, *[1] * (ndim - 1))
