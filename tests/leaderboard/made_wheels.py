"""Wheels made for tests, and those of installed distributions, as pip would have downloaded them."""

from __future__ import annotations

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
