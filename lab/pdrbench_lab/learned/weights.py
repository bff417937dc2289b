"""Weights as safetensors: written with their architecture, read only where hash and shapes are the expected ones."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save
from torch import Tensor

from pdrbench.errors import DatasetError
from pdrbench_baselines.learned.attitude_sources import PHONE
from pdrbench_baselines.learned.constants import CNN
from pdrbench_baselines.learned.weight_files import FORM, PACKAGED, TRAIN, check_form, packaged_file, read_arrays
from pdrbench_lab.learned.model import Network, PhoneNetwork


def store(network: Network | PhoneNetwork, path: Path) -> str:
    """Writes a network; returns the sha256 of the file."""
    tensors = {name: values.detach().cpu().contiguous() for name, values in network.state_dict().items()}
    own = {"arch": network.arch, "width": network.width, "carried": network.carried, "inputs": network.inputs}
    form = json.dumps({**own, **FORM}, sort_keys=True)
    content = save(tensors, metadata={"network": form})
    path.write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def load_network(weights: str = "phone") -> Network | PhoneNetwork:
    """The network of a name in `PACKAGED`, known by its hash, or in a file, in PyTorch."""
    return packaged(weights) if weights in PACKAGED else restore(Path(weights))


def packaged(name: str) -> Network | PhoneNetwork:
    """One of the networks in `PACKAGED`, known by its hash."""
    return restore(packaged_file(name), PACKAGED[name])


def restore(path: Path, sha256: str | None = None) -> Network | PhoneNetwork:
    """A network as it was stored, ready to be asked.

    Args:
        path: Of the file.
        sha256: It has to have; None for any.

    Raises:
        DatasetError: No such file, another hash, another form, or not safetensors at all.
    """
    otherwise = ", or name your own weights by the parameter `weights`"
    tensors, form = read(path, sha256, train=TRAIN, otherwise=otherwise)
    if not {"arch", "width"} <= form.keys():
        raise DatasetError(f"{path}: not the weights of a network (it names none); train with `{TRAIN}`")
    with torch.random.fork_rng(devices=[]):  # a new network draws weights, which are overwritten at once
        network = network_of(str(form["arch"]), int(form["width"]), str(form.get("carried", PHONE)))
    check_form(form, network.inputs, path)
    load_into(network, tensors, path)
    return network.eval()


def read(
    path: Path, sha256: str | None, *, train: str, otherwise: str = ""
) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """`read_arrays`, as tensors."""
    arrays, form = read_arrays(path, sha256, train=train, otherwise=otherwise)
    return {name: torch.from_numpy(values) for name, values in arrays.items()}, form


def network_of(arch: str, width: int, carried: str) -> Network | PhoneNetwork:
    """A new network: `PhoneNetwork` for the architecture "cnn"."""
    return PhoneNetwork() if arch == CNN else Network(arch, width, carried)


def load_into(network: torch.nn.Module, tensors: dict[str, Tensor], path: Path) -> None:
    """Puts tensors in place.

    Raises:
        DatasetError: A name or a shape that the network does not have.
    """
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        if "state_dict" not in str(error):
            raise  # PyTorch itself fails, as where a confined process cannot start it
        what = str(error).splitlines()[-1].strip()
        raise DatasetError(f"{path}: these weights are of another network ({what}); train with `{TRAIN}`") from error
