"""Weights as safetensors: written with their architecture, read only where hash and shapes are the expected ones."""

from __future__ import annotations

import hashlib
import json
import struct
from pathlib import Path
from typing import Any, Final

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from pdrbench.errors import DatasetError
from pdrbench_baselines.learned.attitude_sources import PHONE
from pdrbench_baselines.learned.gait import GAIT, GaitNetwork
from pdrbench_baselines.learned.model import Network
from pdrbench_baselines.learned.signals import HORIZON, RATE_HZ, WINDOW

# sha256 of the weights that come with pdrbench, by name
PACKAGED: Final = {
    "learned-v0": "5601f849824a6c7a27b0608dd1391c6cf4dc456aab4430b785b98b357c5c4f0f",
    "learned-v1": "ec7e542a70598dfc31f6ade684bda7774c7d03e595cc3df4f90963eadec78ca3",
    "learned-v2": "2c1278163e0ea9510877c27611216ee5e290fc9174a99c7b452b00ea841de7fe",
    "learned_foot-v0": "788a7969fa2ed23cada32af4ba8e98bc1ad8067a9fc8d79775f2c61601c219cf",
}
_FORM: Final = {"window": WINDOW, "horizon": HORIZON, "rate_hz": RATE_HZ}


def store(network: Network, path: Path) -> str:
    """Writes a network; returns the sha256 of the file."""
    tensors = {name: values.detach().cpu().contiguous() for name, values in network.state_dict().items()}
    own = {"arch": network.arch, "width": network.width, "carried": network.carried, "inputs": network.inputs}
    form = json.dumps({**own, **_FORM}, sort_keys=True)
    content = save(tensors, metadata={"network": form})
    path.write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def packaged(name: str) -> Network:
    """One of the networks in `PACKAGED`, known by its hash."""
    return restore(Path(__file__).with_name(f"{name}.safetensors"), PACKAGED[name])


def restore(path: Path, sha256: str | None = None) -> Network:
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
    expected = {"inputs": network.inputs, **_FORM}
    other = {name: form.get(name) for name, value in expected.items() if form.get(name) != value}
    if other:
        raise DatasetError(f"{path}: made for {other}, this version expects {expected}; train anew with `{TRAIN}`")
    load_into(network, tensors, path)
    return network.eval()


def read(
    path: Path, sha256: str | None, *, train: str, otherwise: str = ""
) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors of a file by name, and what it says of their network; nothing where it says nothing.

    Args:
        path: Of the file.
        sha256: It has to have; None for any.
        train: Command that makes such a file, for messages.
        otherwise: What else helps where the hash is another.

    Raises:
        DatasetError: No such file, another hash, or not safetensors at all.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}; train with `{train}`") from error
    came = hashlib.sha256(content).hexdigest()
    if sha256 is not None and came != sha256:
        wanted = f"expected {sha256[:12]}...; install pdrbench again{otherwise}"
        raise DatasetError(f"{path}: sha256 is {came[:12]}..., {wanted}")
    try:
        (length,) = struct.unpack("<Q", content[:8])
        tensors, header = load(content), json.loads(content[8 : 8 + length])
        form = json.loads(header.get("__metadata__", {}).get("network", "{}"))
    except (SafetensorError, ValueError, struct.error) as error:
        raise DatasetError(f"{path}: not the weights of a network ({error}); train with `{train}`") from error
    return tensors, form if isinstance(form, dict) else {}


def network_of(arch: str, width: int, carried: str) -> Network:
    """A new network: `GaitNetwork` for the architecture "gait"."""
    return GaitNetwork(width, carried) if arch == GAIT else Network(arch, width, carried)


def load_into(network: torch.nn.Module, tensors: dict[str, Tensor], path: Path) -> None:
    """Puts tensors in place.

    Raises:
        DatasetError: A name or a shape that the network does not have.
    """
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        what = str(error).splitlines()[-1].strip()
        raise DatasetError(f"{path}: these weights are of another network ({what}); train with `{TRAIN}`") from error


TRAIN: Final = "python -m pdrbench_baselines.learned train --out DIR"
