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
from pdrbench_baselines.learned.constants import CNN, INPUTS
from pdrbench_baselines.learned.weight_files import FORM, PACKAGED, PACKAGED_SHA256, TRAIN, check_form, read_arrays
from pdrbench_lab.learned.model import PhoneNetwork


def store(network: PhoneNetwork, path: Path) -> str:
    """Writes a network; returns the sha256 of the file."""
    tensors = {name: values.detach().cpu().contiguous() for name, values in network.state_dict().items()}
    form = json.dumps({"arch": CNN, "inputs": INPUTS, **FORM}, sort_keys=True)
    content = save(tensors, metadata={"network": form})
    path.write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def load_network(weights: str | None = None) -> PhoneNetwork:
    """The network that comes with pdrbench, known by its hash, or that of a file, in PyTorch."""
    return restore(PACKAGED, PACKAGED_SHA256) if weights is None else restore(Path(weights))


def restore(path: Path, sha256: str | None = None) -> PhoneNetwork:
    """A network as it was stored, ready to be asked.

    Args:
        path: Of the file.
        sha256: It has to have; None for any.

    Raises:
        DatasetError: No such file, another hash, another form or network, or not safetensors at all.
    """
    otherwise = ", or name your own weights by the parameter `weights`"
    tensors, form = read(path, sha256, train=TRAIN, otherwise=otherwise)
    if form.get("arch") != CNN:
        raise DatasetError(f"{path}: {form.get('arch')!r} is no network of this version; train with `{TRAIN}`")
    check_form(form, INPUTS, path)
    with torch.random.fork_rng(devices=[]):  # a new network draws weights, which are overwritten at once
        network = PhoneNetwork()
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        if "state_dict" not in str(error):
            raise  # PyTorch itself fails, as where a confined process cannot start it
        what = str(error).splitlines()[-1].strip()
        raise DatasetError(f"{path}: these weights are of another network ({what}); train with `{TRAIN}`") from error
    return network.eval()


def read(
    path: Path, sha256: str | None, *, train: str, otherwise: str = ""
) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """`read_arrays`, as tensors."""
    arrays, form = read_arrays(path, sha256, train=train, otherwise=otherwise)
    return {name: torch.from_numpy(values) for name, values in arrays.items()}, form
