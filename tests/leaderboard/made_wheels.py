"""Wheels made for tests, and those of installed distributions, as pip would have downloaded them."""

from __future__ import annotations

import importlib.metadata
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

FOREIGN = {"foreign/__init__.py": "def scale():\n    return 2.0\n"}


def make_wheel(
    folder: Path,
    files: Mapping[str, str] = FOREIGN,
    *,
    name: str = "foreign",
    version: str = "1.0",
    tag: str = "py3-none-any",
    needs: Sequence[str] = (),
) -> Path:
    """A wheel of some files."""
    folder.mkdir(parents=True, exist_ok=True)
    described = f"{name}-{version}.dist-info"
    metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    metadata += "".join(f"Requires-Dist: {line}\n" for line in needs)
    whole = {**files, f"{described}/METADATA": metadata, f"{described}/WHEEL": f"Wheel-Version: 1.0\nTag: {tag}\n"}
    whole[f"{described}/RECORD"] = "".join(f"{path},,\n" for path in whole)
    path = folder / f"{name}-{version}-{tag}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as wheel:
        for place, text in whole.items():
            wheel.writestr(place, text)
    return path


def repack(folder: Path, distribution: str) -> Path:
    """The wheel that an installed distribution came from, but for what is compiled from its sources."""
    found = importlib.metadata.distribution(distribution)
    folder.mkdir(parents=True, exist_ok=True)
    lines = (found.read_text("WHEEL") or "").splitlines()
    tag = next(line.partition(": ")[2] for line in lines if line.startswith("Tag: "))
    path = folder / f"{distribution.replace('-', '_')}-{found.version}-{tag}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as wheel:
        for file in found.files or ():
            if ".." not in file.parts and "__pycache__" not in file.parts and Path(file.locate()).is_file():
                wheel.write(str(file.locate()), str(file))
    return path
