"""What decides whether a stored result is used again: versions, and the bytes of the localizer."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pdrbench.errors import PluginError
from pdrbench.evaluation.origin import environment_version, package_sha256, target_sha256
from pdrbench.files import bytes_sha256


def test_a_file_counts_by_its_bytes_also_twice_within_a_second(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    digests = []
    for text in ("x = 1\n", "x = 2\n", "x = 2  # said\n"):
        file.write_text(text)
        digests.append(target_sha256(f"{file}:Mine"))
    assert len(set(digests)) == 3
    with pytest.raises(PluginError, match=r"no file .*gone\.py"):
        target_sha256(f"{tmp_path}/gone.py:Mine")


def test_hidden_and_compiled_files_do_not_count_names_do(tmp_path: Path) -> None:
    (tmp_path / "inside").mkdir()
    (tmp_path / "inside/a.py").write_text("x = 1")
    before = bytes_sha256([tmp_path])
    for name in ("__pycache__", ".git"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "b.py").write_text("y = 1")
    assert bytes_sha256([tmp_path]) == before
    (tmp_path / "inside/a.py").rename(tmp_path / "inside/c.py")
    assert bytes_sha256([tmp_path]) != before


def test_a_package_counts_as_a_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "whole_package").mkdir()
    (tmp_path / "whole_package/__init__.py").touch()
    (tmp_path / "whole_package/net.npy").write_bytes(b"1")
    monkeypatch.syspath_prepend(tmp_path)
    before = target_sha256("whole_package.inner:Mine")
    (tmp_path / "whole_package/net.npy").write_bytes(b"2")
    assert target_sha256("whole_package.inner:Mine") != before
    with pytest.raises(PluginError, match="no module 'no_such_package'"):
        package_sha256("no_such_package")


def test_an_environment_is_its_package_and_version_a_file_its_bytes(tmp_path: Path) -> None:
    assert environment_version("Corridor-v0") == "corridor-plugin 1.0"
    file = tmp_path / "place.py"
    file.write_text("x = 1")
    before = environment_version(f"{file}:task")
    file.write_text("x = 2")
    os.utime(file, (0, 0))
    assert environment_version(f"{file}:task") != before


def test_a_class_that_a_file_does_not_define_is_known_without_running_it(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import os\nclass Mine: pass\n")
    assert len(target_sha256(f"{tmp_path / 'mine.py'}:Mine")) == 64
    with pytest.raises(PluginError, match=r"defines no 'Mnie': .*did you mean 'Mine'"):
        target_sha256(f"{tmp_path / 'mine.py'}:Mnie")
    (tmp_path / "mine.py").write_text("from os.path import *\nMade = make('Mine')\n")
    assert len(target_sha256(f"{tmp_path / 'mine.py'}:Made")) == 64
