"""The page "Submit a folder" works: every block, in order, where its requirement is not installed."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from pdrbench_leaderboard.bundle import SUFFIX, read_bundle
from pdrbench_leaderboard.confine.shared_modules import shared_distributions
from pdrbench_leaderboard.entry import read_entry
from pdrbench_leaderboard.folder_archive import ARCHIVE_FILE, read_archive

from .documented import follow
from .made_wheels import make_wheel, repack

PAGE = Path(__file__).resolve().parents[2] / "docs" / "submit-folder.md"
REARRANGE = "def rearrange(array, pattern):\n    assert pattern == 'columns -> 1 columns'\n    return array[None]\n"
TORCH = ("filelock", "fsspec", "mpmath", "networkx", "setuptools", "sympy", "torch", "typing-extensions")

pytestmark = pytest.mark.skipif(not PAGE.is_file(), reason="documentation is not part of a wheel")


@pytest.mark.long(seconds=300)
@pytest.mark.timeout(1800)
def test_from_a_folder_to_a_row(tmp_path: Path) -> None:
    """A network, with wheels of torch as it is installed, and one of a package that is nowhere installed."""
    pytest.importorskip("torch")
    assert importlib.util.find_spec("einops") is None, "a requirement that is not installed"
    folder = tmp_path / "empty"
    make_wheel(folder / "wheels", {"einops.py": REARRANGE}, name="einops", version="0.8.0")
    for distribution in TORCH:
        if distribution not in shared_distributions():
            repack(folder / "wheels", distribution)
    version = "{}.{}".format(*sys.version_info)
    ran = follow(
        PAGE,
        folder,
        tmp_path / "bin",
        {"PDRBENCH_CACHE": str(tmp_path / "cache")},
        lambda text: text.replace('python = "3.11"', f'python = "{version}"'),
    )
    assert ran == 5
    (bundle,) = (read_bundle(path.read_bytes()) for path in folder.glob(f"*{SUFFIX}"))
    archive = read_archive(bundle.source[ARCHIVE_FILE])
    assert [one.name for one in archive.lock if one.name in ("einops", "torch")] == ["einops", "torch"]
    assert {walk.status for record in bundle.manifest.environments for walk in record.walks} == {"complete"}
    (packages,) = (tmp_path / "cache-packages").iterdir()
    assert (packages / "einops.py").read_text() == REARRANGE and (packages / "torch").is_dir()
    (entry,) = (folder / "leaderboards").glob("OfficeStride-v*/stridenet-v0")
    assert read_entry(entry).tier == "reproduced"
