"""Folders as submissions: what is packed, what they require, and how they are run again where that is not installed."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.metadata
import io
import shutil
import textwrap
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import BundleError
from pdrbench.evaluation import evaluate
from pdrbench_leaderboard import folder_archive, packages
from pdrbench_leaderboard.bundle import write_bundle, write_members
from pdrbench_leaderboard.card import card_toml
from pdrbench_leaderboard.confine.shared_modules import shared_distributions
from pdrbench_leaderboard.folder_archive import pack_folder, read_archive, unpack
from pdrbench_leaderboard.folders import Supplies, check_packable
from pdrbench_leaderboard.packages import Locked, install, lock_of, lock_text, parse_lock
from pdrbench_leaderboard.submission import check_bundle, make_bundle, unpack_bundle

from .conftest import ENV, STAY, card_named
from .made_wheels import FOREIGN, make_wheel

NET = """
    import foreign
    import numpy as np
    from pdrbench import Estimate
    from parts import WEIGHTS

    class Net:
        def reset(self, briefing, rng):
            briefing.require(sensors=("position",))
            self.xy_m, self.weights = np.zeros(2), np.load(WEIGHTS)
        def step(self, observation):
            for row in observation["position"]:
                self.xy_m = row[1:3] + foreign.scale() * self.weights
            return Estimate(xy_m=self.xy_m, level=0)
"""
SHA = "0" * 64


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of wheels with one that is not installed here."""
    folder = tmp_path_factory.mktemp("wheels")
    make_wheel(folder)
    return folder


@pytest.fixture(scope="module")
def installed(cache: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which what is locked has been unpacked."""
    return install(lock_of(cache), cache, tmp_path_factory.mktemp("packages")).folder


@pytest.fixture
def net(tmp_path: Path, cache: Path) -> Path:
    """A folder with two modules, weights and a lock."""
    folder = tmp_path / "net"
    folder.mkdir()
    (folder / "model.py").write_text(textwrap.dedent(NET))
    (folder / "parts.py").write_text("WEIGHTS = __file__.replace('parts.py', 'net.npy')\n")
    np.save(folder / "net.npy", np.array([0.125, 0.25]))
    (folder / "requirements.txt").write_text(lock_text(lock_of(cache)))
    (folder / "localizer.toml").write_text(
        f"entry = 'model.py:Net'\nrequirements = 'requirements.txt'\n[weights.'net.npy']\n"
        f"bytes = {(folder / 'net.npy').stat().st_size}\nsha256 = '{sha256(folder / 'net.npy')}'\n"
    )
    return folder


def test_a_lock_is_read_as_pip_writes_it() -> None:
    text = f"""
        # made by pip-compile
        --index-url https://example.org/simple
        Foo_Bar[extra]==1.0 \\
            --hash=sha256:{SHA} \\
            --hash=sha256:{"1" * 64}
            # via -r requirements.in
        torch==2.5.0+cpu --hash=sha256:{SHA}  # a comment
        other==3 ; sys_platform == "nowhere" --hash=sha256:{SHA}
        here==3.0.0 ; python_version >= "3.8" --hash=sha256:{SHA}
    """
    locked = parse_lock(textwrap.dedent(text).encode(), "lock")
    assert locked == (
        Locked("foo-bar", "1.0", frozenset({SHA, "1" * 64})),
        Locked("here", "3.0.0", frozenset({SHA})),
        Locked("torch", "2.5.0+cpu", frozenset({SHA})),
    )
    assert parse_lock(lock_text(locked).encode(), "again") == locked
    assert parse_lock(b"", "empty") == ()


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("foo", "not one version"),
        ("foo @ https://example.org/foo.whl", "not one version"),
        ("-e ./foo", "not one version"),
        ("foo==1.0", "has no sha256"),
        ("foo==1.0 --hash=md5:" + "0" * 32, "has no sha256"),
        (f"foo==1.0 --hash=sha256:{SHA}\nFoo==2.0 --hash=sha256:{SHA}", "locks foo twice"),
        ("\udcff", "no text"),
        (f"foo==1.0 ; {'(' * 900} --hash=sha256:{SHA}", "not one version"),
        ("foo==1.0 ;" + " --hash=x" * 11_000 + "!", "not one version"),
        ("a \\\n" * 300_000, "more than 1000 characters"),
    ],
)
def test_whatever_is_not_locked_with_its_digest_is_refused(line: str, why: str) -> None:
    with pytest.raises(BundleError, match=why):
        parse_lock(line.encode(errors="surrogateescape"), "lock")


def test_what_is_locked_is_unpacked_once_and_offline(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    numpy = Locked("numpy", "1.0", frozenset({SHA}))
    installed = install([*lock_of(cache), numpy], cache, tmp_path / "packages")
    assert (installed.folder / "foreign/__init__.py").read_text() == FOREIGN["foreign/__init__.py"]
    assert not (installed.folder / "numpy").exists(), "it comes with pdrbench"
    assert installed.shared == {"numpy": f"{shared_distributions()['numpy']} here, 1.0 is locked"}
    assert [path.name for path in (tmp_path / "packages").iterdir()] == [installed.folder.name], (
        "nothing is left behind"
    )
    monkeypatch.setattr(packages, "_run_pip", None)
    assert install(lock_of(cache), cache, tmp_path / "packages").folder == installed.folder


def test_each_wheel_that_is_not_there_has_an_error_of_its_own(cache: Path, tmp_path: Path) -> None:
    (foreign,) = lock_of(cache)

    def refused(locked: Locked, folder: Path | None, why: str) -> None:
        with pytest.raises(BundleError, match=why):
            install([locked], folder, tmp_path / "packages")

    refused(foreign, None, "name a folder of wheels with --wheels")
    refused(dataclasses.replace(foreign, sha256=frozenset({SHA})), cache, "DO NOT MATCH THE HASHES")
    assert not [*(tmp_path / "packages").iterdir()], "nothing is left behind"


def test_a_folder_of_wheels_is_locked_with_one_version_of_each(tmp_path: Path) -> None:
    with pytest.raises(BundleError, match="no wheels in"):
        lock_of(tmp_path)
    make_wheel(tmp_path, name="numpy")
    make_wheel(tmp_path)
    assert [one.name for one in lock_of(tmp_path)] == ["foreign"], "pdrbench brings the other"
    make_wheel(tmp_path, version="1.1")
    with pytest.raises(BundleError, match="in two versions"):
        lock_of(tmp_path)


def test_a_folder_is_the_same_bytes_and_comes_back(net: Path, tmp_path: Path) -> None:
    content = pack_folder(net)
    (net / "__pycache__").mkdir()
    (net / "__pycache__/x.pyc").write_bytes(b"\xff")
    assert pack_folder(net) == content
    archive = read_archive(content)
    assert archive.summary == "5 files, 1 of weights, 1 locked requirements"
    unpack(archive, tmp_path / "again")
    assert pack_folder(tmp_path / "again") == content


def test_weights_above_the_limit_are_put_beside_by_digest(
    net: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(folder_archive, "MAX_WEIGHTS_INSIDE", 100)
    archive = read_archive(pack_folder(net))
    assert (archive.absent, "net.npy" in archive.files) == (("net.npy",), False)
    beside = tmp_path / "weights"
    beside.mkdir()
    for places in (None, beside):
        with pytest.raises(BundleError, match=r"did not travel with it.*" + sha256(net / "net.npy")):
            unpack(archive, tmp_path / "again", places)
    changed = (net / "net.npy").read_bytes()[:-1] + b"\x41"
    (beside / "a").write_bytes(changed)
    with pytest.raises(BundleError, match="did not travel with it"):
        unpack(archive, tmp_path / "again", beside)
    shutil.copy(net / "net.npy", beside / "under another name")
    unpack(archive, tmp_path / "again", beside)
    assert (tmp_path / "again/net.npy").read_bytes() == (net / "net.npy").read_bytes()


Members = dict[str, bytes]


def without_settings(members: Members) -> Members:
    return {name: content for name, content in members.items() if name != "localizer.toml"}


ODD: dict[str, Callable[[Members], Members]] = {
    "neither localizer.toml nor pyproject.toml": without_settings,
    "localizer.toml: unknown|localizer.toml: Object contains unknown": lambda m: (
        m | {"localizer.toml": m["localizer.toml"] + b"[colour]\n"}
    ),
    "its lock is missing|lock is missing": lambda m: {n: c for n, c in m.items() if n != "requirements.txt"},
    "not those that it declares": lambda m: m | {"net.npy": b"other"},
    "other.bin is no text": lambda m: m | {"other.bin": b"\xff"},
    "but for capitals": lambda m: m | {"Model.py": b""},
    "a member is named": lambda m: m | {"../x.py": b""},
    "8000000 bytes without weights": lambda m: m | {"long.py": b" " * 8_000_001},
}


@pytest.mark.parametrize("why", ODD)
def test_an_archive_that_is_not_as_it_says_is_refused(net: Path, why: str) -> None:
    with zipfile.ZipFile(io.BytesIO(pack_folder(net))) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with pytest.raises(BundleError, match=why):
        read_archive(write_members(ODD[why](members)))


def test_an_archive_for_another_python_is_refused_where_it_is_unpacked(net: Path, tmp_path: Path) -> None:
    text = (net / "localizer.toml").read_text()
    (net / "localizer.toml").write_text("python = '3.99'\n" + text)
    archive = read_archive(pack_folder(net))
    with pytest.raises(BundleError, match=r"is for Python 3\.99; this is 3"):
        unpack(archive, tmp_path / "again")


def test_a_binary_file_that_is_not_declared_is_named_with_the_lines_that_declare_it(net: Path) -> None:
    (net / "other.bin").write_bytes(b"\xff\x00")
    with pytest.raises(BundleError, match=r"other\.bin is no text; declare it") as error:
        pack_folder(net)
    with (net / "localizer.toml").open("a") as settings:
        settings.write(str(error.value).split("away:\n")[1])
    assert "2 of weights" in read_archive(pack_folder(net)).summary


def test_what_is_imported_and_not_locked_is_found_before_a_walk_is_played(net: Path, installed: Path) -> None:
    with pytest.raises(BundleError, match=r"locks foreign 1\.0, and it is not installed"):
        check_packable(str(net))
    check_packable(f"{net}@{installed}")
    (net / "model.py").write_text("import hypothesis, numpy, parts, os\nclass Net: pass\n")
    (net / "requirements.txt").write_text("")
    with pytest.raises(BundleError, match="imports 'hypothesis' from hypothesis and does not lock it"):
        check_packable(str(net))
    text = (net / "localizer.toml").read_text()
    (net / "localizer.toml").write_text(text.replace("requirements = 'requirements.txt'\n", ""))
    with pytest.raises(BundleError, match="and has no lock"):
        check_packable(str(net))
    (net / "requirements.txt").write_text(f"hypothesis==0.1 --hash=sha256:{SHA}")
    (net / "localizer.toml").write_text(text)
    with pytest.raises(BundleError, match=r"locks hypothesis 0\.1, and \d+\.\d+\S* is installed"):
        check_packable(str(net))
    here = importlib.metadata.version("hypothesis")
    (net / "requirements.txt").write_text(f"hypothesis=={here} --hash=sha256:{SHA}")
    check_packable(str(net))
    check_packable(STAY)
    check_packable("somewhere/file.py:Net")


def test_a_folder_travels_and_is_unpacked_with_what_it_requires(
    net: Path, installed: Path, tmp_path: Path, cache: Path
) -> None:
    (net / "card.toml").write_bytes(card_toml(card_named("net")))
    bundle = make_bundle(f"{net}@{installed}", net / "card.toml")
    assert (bundle.spec, [*bundle.source]) == ("folder.zip", ["folder.zip"])
    path = tmp_path / "net.pdrz"
    path.write_bytes(write_bundle(bundle))
    findings = check_bundle(path)
    assert all(found.passed for found in findings)
    assert any("1 of weights, 1 locked requirements" in found.why for found in findings)
    supplies = Supplies(wheels=cache, packages=tmp_path / "theirs")
    spec, card = unpack_bundle(path, tmp_path / "unpacked", supplies)
    assert card.name == "net" and spec.startswith(str(tmp_path / "unpacked"))
    found = evaluate(spec, ENV, walks=1, seeds=1)
    assert found.results[0].status == "complete", found.results[0].failure


def test_a_bundle_whose_folder_cannot_be_read_does_not_pass(net: Path, installed: Path, tmp_path: Path) -> None:
    (net / "card.toml").write_bytes(card_toml(card_named("net")))
    bundle = make_bundle(f"{net}@{installed}")
    torn = dataclasses.replace(bundle, source={"folder.zip": pack_folder(net)[:-10]})
    path = tmp_path / "net.pdrz"
    path.write_bytes(write_bundle(torn))
    findings = {finding.name: finding for finding in check_bundle(path)}
    assert not findings["its folder"].passed and "no bundle" in findings["its folder"].why
