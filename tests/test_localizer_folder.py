"""A localizer that is a folder: what it may say of itself, which files belong to it, what it imports and reads."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from pdrbench.errors import PluginError
from pdrbench.evaluation import evaluate
from pdrbench.evaluation.origin import localizer_target, target_sha256
from pdrbench.localizer_folder import FolderTarget, find_target, list_files, parse_settings, parse_target, read_settings
from pdrbench.registry import load_localizer
from pdrbench_leaderboard.confine.read_permissions import permissions_of
from pdrbench_leaderboard.confine.shared_modules import shared_distributions, shared_modules

ENV = "CampusStride-v1"
HERE = f"{sys.version_info.major}.{sys.version_info.minor}"
MODEL = """
    import numpy as np
    from pdrbench import Estimate
    from parts.place import PLACE_M

    class Net:
        def reset(self, briefing, rng):
            self.weights = np.load(__file__.replace("model.py", "net.npy"))
        def step(self, observation):
            return Estimate(xy_m=PLACE_M + self.weights, level=0)

    number = 5
"""
WEIGHTS = np.array([0.25, -0.5])


def declared(content: bytes) -> str:
    return f"bytes = {len(content)}\nsha256 = '{hashlib.sha256(content).hexdigest()}'\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a module, a package, weights and what does not belong to it."""
    place = tmp_path / "net"
    (place / "parts").mkdir(parents=True)
    (place / "model.py").write_text(textwrap.dedent(MODEL))
    (place / "parts/__init__.py").touch()
    (place / "parts/place.py").write_text("import numpy as np\nPLACE_M = np.array([1.0, 2.0])\n")
    np.save(place / "net.npy", WEIGHTS)
    weights = (place / "net.npy").read_bytes()
    (place / "localizer.toml").write_text(
        f"entry = 'model.py:Net'\npython = '{HERE}'\n[weights.'net.npy']\n{declared(weights)}"
    )
    for name in (".git/config", "__pycache__/model.pyc", "net.egg-info/PKG-INFO", "venv/pyvenv.cfg", "old.pdrz"):
        (place / name).parent.mkdir(exist_ok=True)
        (place / name).write_text("not packed")
    return place


def settings(folder: Path, text: str) -> None:
    (folder / "localizer.toml").write_text(text)


def test_a_folder_is_run_in_every_isolation(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("model", "parts", "parts.place"):  # left behind by the isolation "none"
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
        del sys.modules[name]
    for isolation in ("process", "none"):
        results = evaluate(str(folder), ENV, split="val", seeds=1, walks=1, isolation=isolation).results  # type: ignore[arg-type]
        assert (results[0].status, results[0].failure) == ("complete", "")
        assert np.array_equal(results[0].estimates.xy_m[0], [1.25, 1.5])
        assert results[0].provenance["localizer_sha256"] == target_sha256(localizer_target(str(folder)))


def test_a_target_is_the_same_as_text(folder: Path, tmp_path: Path) -> None:
    found = find_target(str(folder))
    assert found == FolderTarget(folder, None, "model", "Net")
    (tmp_path / "packages").mkdir()
    with_packages = find_target(f"{folder}@{tmp_path}/packages")
    assert with_packages == FolderTarget(folder, tmp_path / "packages", "model", "Net")
    for target in (found, with_packages):
        assert target is not None and parse_target(str(target)) == target
    assert parse_target("/some/file.py:Net") is parse_target("package.module:Net") is None
    assert find_target("stay") is find_target("package.module:Net") is None


@pytest.mark.parametrize("below", ["", "src/"])
def test_an_entry_may_be_a_file_or_a_module_at_the_top_or_below_src(tmp_path: Path, below: str) -> None:
    (tmp_path / below / "deep/er").mkdir(parents=True)
    (tmp_path / below / "deep/er/model.py").touch()
    for entry in ("deep.er.model:Net", "deep/er/model.py:Net"):
        settings(tmp_path, f"entry = '{entry}'")
        assert find_target(str(tmp_path)) == FolderTarget(tmp_path, None, "deep.er.model", "Net")


def test_settings_may_stand_in_pyproject(folder: Path) -> None:
    text = (folder / "localizer.toml").read_text().replace("[weights.", "[tool.pdrbench.weights.")
    (folder / "localizer.toml").unlink()
    (folder / "pyproject.toml").write_text(f"[project]\nname = 'net'\n[tool.pdrbench]\n{text}")
    assert find_target(str(folder)) == FolderTarget(folder, None, "model", "Net")


WRONG = {
    "entry = 'model.py:Net'\npython = '2.7'": "is for Python 2.7; this is",
    "entry = 'model.py:Net'\nrequirements = 'lock.txt'": "its lock is missing: no file lock.txt",
    "entry = 'other.py:Net'": "its entry is not found: no module 'other' in it",
    "entry = '../model.py:Net'": "the entry is written",
    "entry = 'model.py'": "the entry is written",
    "entry = 'model.py:Net'\ncolour = 'red'": "unknown field `colour`",
    "entry = 3": "Expected `str`, got `int`",
    "entry =": "Invalid value",
    "entry = 'model.py:Net'\n[weights.'../../etc/passwd']\nbytes = 3\nsha256 = 'x'": "matching regex",
    "entry = 'model.py:Net'\n[weights.'gone.npy']\nbytes = 3\nsha256 = '"
    + "0" * 64
    + "'": "weights gone.npy are missing",
}


@pytest.mark.parametrize("text", WRONG)
def test_each_wrong_setting_has_an_error_of_its_own(folder: Path, text: str) -> None:
    settings(folder, text)
    with pytest.raises(PluginError, match="(?s)" + WRONG[text].replace("[", r"\[")):
        find_target(str(folder))
    assert len({*WRONG.values()}) == len(WRONG) - 1, "but for the two that are written wrongly"


def test_weights_that_changed_are_refused_with_the_lines_that_declare_them(folder: Path) -> None:
    changed = (folder / "net.npy").read_bytes()[:-1] + b"\x40"
    (folder / "net.npy").write_bytes(changed)
    with pytest.raises(PluginError, match=r"weights net\.npy are not those") as error:
        find_target(str(folder))
    lines = str(error.value).split("write\n")[1]
    settings(folder, f"entry = 'model.py:Net'\n{lines}")
    assert find_target(str(folder)) is not None


def test_other_places_have_errors_of_their_own(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for name, why in (
        (f"{tmp_path}/empty", "neither localizer.toml nor pyproject.toml"),
        (f"{tmp_path}/gone", "no folder"),
        (f"{folder}@{tmp_path}/gone", "no folder .*gone with the packages"),
    ):
        with pytest.raises(PluginError, match=why):
            find_target(name)
    (tmp_path / "empty/pyproject.toml").write_text("[project]\nname = 'x'\n")
    with pytest.raises(PluginError, match=r"no table \[tool.pdrbench\]"):
        find_target(f"{tmp_path}/empty")


def test_settings_of_any_depth_are_read_or_refused() -> None:
    for content in (b"\xff", b"a" * 9_000_000, b"entry = " + b"[" * 100_000, b"entry = 'a.py:B'\nweights = {}"):
        for is_project in (True, False):
            try:
                parse_settings(content, is_project=is_project)
            except PluginError as error:
                assert str(error)


def test_what_belongs_to_a_folder(folder: Path) -> None:
    names = ["localizer.toml", "model.py", "net.npy", "parts/__init__.py", "parts/place.py"]
    assert [*list_files(folder, read_settings(folder))] == names
    before = target_sha256(localizer_target(str(folder)))
    (folder / ".git/config").write_text("other")
    assert target_sha256(localizer_target(str(folder))) == before
    (folder / "parts/place.py").write_text("import numpy as np\nPLACE_M = np.array([1.0, 2.5])\n")
    assert target_sha256(localizer_target(str(folder))) != before


def test_links_names_and_amounts_are_limited(folder: Path, tmp_path: Path) -> None:
    def refused(why: str) -> None:
        with pytest.raises(PluginError, match=why):
            list_files(folder, read_settings(folder))

    (folder / "link").symlink_to("/etc/passwd")
    refused("link is a link")
    (folder / "link").unlink()
    (folder / "folder").symlink_to(tmp_path, target_is_directory=True)
    refused("folder is a link")
    (folder / "folder").unlink()
    (folder / "a b.py").touch()
    refused("name that no other system may have")
    (folder / "a b.py").unlink()
    (folder / "data.csv").write_bytes(b"0" * 8_000_000)
    refused("8000000 bytes without declared weights")
    (folder / "data.csv").unlink()
    (folder / "/".join("abcdefghij")).mkdir(parents=True)
    (folder / "/".join("abcdefghij") / "deep.py").touch()
    refused("more than 8 folders deep")


def test_only_what_belongs_to_it_can_be_read(folder: Path) -> None:
    permissions = permissions_of(str(folder), localizer_target(str(folder)))
    assert str(folder / "net.npy") in permissions.readable
    assert not {str(folder), str(folder / ".git"), str(folder.parent)} & set(permissions.readable)
    assert str(folder) in permissions.listed
    assert "parts.place" in permissions.imports
    (folder / "model.py").write_text("import parts.other\n")
    (folder / "parts/other.py").touch()
    permissions = permissions_of(str(folder), localizer_target(str(folder)))
    assert str(folder / "parts/other.py") in permissions.readable
    assert "parts.other" in permissions.imports


IMPORTS = """
    import importlib.util
    import numpy as np
    from pdrbench import Estimate

    class Net:
        def reset(self, briefing, rng):
            import foreign, scipy.optimize
            assert foreign.WHERE == "packages", foreign.WHERE
            assert importlib.util.find_spec("hypothesis") is None
            try:
                open(__file__.replace("model.py", ".git/config"))
            except OSError:
                print("what is not packed cannot be read")
            import hypothesis
        def step(self, observation):
            return Estimate(xy_m=np.zeros(2), level=0)
"""


def test_with_packages_of_its_own_it_imports_nothing_else_that_is_installed(folder: Path, tmp_path: Path) -> None:
    (folder / "model.py").write_text(textwrap.dedent(IMPORTS))
    packages = tmp_path / "packages"
    packages.mkdir()
    (packages / "foreign.py").write_text("WHERE = 'packages'\n")
    spec = f"{folder}@{packages}"
    (result,) = evaluate(spec, ENV, split="val", seeds=1, walks=1, isolation="confined").results
    assert result.status == "failed"
    assert "No module named 'hypothesis'" in result.failure, result.failure
    isolation: Any = result.provenance["isolation"]
    if "landlock-files" in isolation["held"]:
        assert "what is not packed cannot be read" in result.failure
    before = target_sha256(localizer_target(spec))
    (packages / "foreign-1.0.dist-info").mkdir()
    (packages / "foreign-1.0.dist-info/RECORD").write_text("foreign.py,sha256=x,1\n")
    assert target_sha256(localizer_target(spec)) != before, "what is installed there counts"


def test_pdrbench_and_what_it_needs_stay() -> None:
    assert {"pdrbench", "numpy", "scipy", "python-dateutil"} <= shared_distributions().keys()
    assert {"pdrbench", "pdrbench_baselines", "numpy", "sklearn", "dateutil", "packaging"} <= shared_modules()
    assert not {"torch", "hypothesis", "pytest"} & (shared_distributions().keys() | shared_modules())


def test_a_file_that_imports_its_neighbour_is_told_to_become_a_folder(folder: Path) -> None:
    (folder / "one.py").write_text("import two\nclass Net: pass\n")
    (folder / "two.py").touch()
    with pytest.raises(
        PluginError, match=r"imports 'two', which lies beside it.*`entry = \"one.py:Net\"`.*name that folder"
    ):
        load_localizer(f"{folder}/one.py:Net")
    (folder / "one.py").write_text("import nowhere_at_all\nclass Net: pass\n")
    with pytest.raises(PluginError, match="No module named 'nowhere_at_all'"):
        load_localizer(f"{folder}/one.py:Net")


def test_what_a_folder_raises_names_it(folder: Path, tmp_path: Path) -> None:
    wrong = {"import nowhere_at_all": "imports 'nowhere_at_all'", "1 / 0": "ZeroDivisionError", "": "its entry"}
    folders = [shutil.copytree(folder, tmp_path / f"net{number}") for number in range(len(wrong))]
    for place, text in zip(folders, wrong, strict=True):
        (place / "model.py").write_text(text)
    results = evaluate([*map(str, folders)], ENV, split="val", seeds=1, walks=1).results
    for result, place, why in zip(results, folders, wrong.values(), strict=True):
        assert result.status == "failed" and f"{place}" in result.failure and why in result.failure


def test_a_second_edit_within_a_second_is_the_one_that_runs(folder: Path) -> None:
    load = "import sys; from pdrbench.registry import load_localizer; load_localizer(sys.argv[1])"
    program = f"{load}; import model; print(model.number)"
    text = (folder / "model.py").read_text()
    for number in ("5", "6"):  # the same size, and the same time of change
        (folder / "model.py").write_text(text.replace("number = 5", f"number = {number}"))
        os.utime(folder / "model.py", (1e9, 1e9))
        ran = subprocess.run([sys.executable, "-c", program, str(folder)], capture_output=True, text=True, check=True)
        assert ran.stdout.strip() == number
