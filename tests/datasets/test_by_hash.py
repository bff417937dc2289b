"""Files that are known by their hashes are found under any name."""

from __future__ import annotations

import gzip
import shutil

import pytest

from pdrbench.datasets.by_hash import locate
from pdrbench.errors import DatasetError

PATH = "data/Samsung_A_Hard_InHand_1/stepcounter.csv.gz"


def test_it_says_how_to_get_what_is_not_there(monkeypatch, tmp_path):
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path))
    with pytest.raises(DatasetError, match="not available"):
        locate("phone_steps")


@pytest.mark.data
def test_by_hash_by_content_and_not_otherwise(data_root, monkeypatch, tmp_path):
    if not (data_root / "phone_steps").is_dir():
        pytest.skip("phone_steps not found")
    source = locate("phone_steps")[PATH]
    folder = tmp_path / "phone_steps"
    folder.mkdir()
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    shutil.copyfile(source, folder / "any.name")
    assert locate("phone_steps") == {PATH: folder / "any.name"}
    content = gzip.decompress((folder / "any.name").read_bytes())
    (folder / "any.name").write_bytes(gzip.compress(content, compresslevel=1))
    assert locate("phone_steps") == {PATH: folder / "any.name"}
    (folder / "any.name").write_bytes(gzip.compress(content[:-10]))
    assert locate("phone_steps") == {}
