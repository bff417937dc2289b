"""Bundles and entries that lie, class by class: each is refused, and the refusal says why in one harmless line."""

from __future__ import annotations

import dataclasses
import datetime
import hashlib
import io
import json
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from pdrbench.errors import BundleError
from pdrbench_leaderboard import bundle as bundles
from pdrbench_leaderboard import signing, submit_command
from pdrbench_leaderboard.boards import Board
from pdrbench_leaderboard.bundle import Bundle, read_bundle, write_bundle
from pdrbench_leaderboard.checking import check_board
from pdrbench_leaderboard.record import Verification, is_verified, read_entry, sign_entry
from pdrbench_leaderboard.run import Settings
from pdrbench_leaderboard.standings import read_tables
from pdrbench_leaderboard.submission import check_bundle, make_bundle

from .conftest import card_named

Members = dict[str, bytes]
SINCE = datetime.date(2026, 1, 1)


@pytest.fixture
def packed(mine: tuple[str, Path]) -> Bundle:
    return make_bundle(*mine)


def call(*arguments: object) -> Result:
    """`pdrbench submit`."""
    return CliRunner().invoke(submit_command.app, [str(argument) for argument in arguments])


def broken(path: Path) -> str:
    """Why a file is refused; empty where it is not."""
    return "; ".join(f"{found.name}: {found.why}" for found in check_bundle(path) if not found.passed)


def members_of(bundle: Bundle) -> Members:
    with zipfile.ZipFile(io.BytesIO(write_bundle(bundle))) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def zipped(members: Members, compression: int = zipfile.ZIP_STORED) -> bytes:
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content, compression)
    return target.getvalue()


def with_json(members: Members, change: Callable[[Any], object], name: str = "manifest.json") -> Members:
    """Members with a JSON file changed in place."""
    plain = json.loads(members[name])
    change(plain)
    return members | {name: json.dumps(plain).encode()}


def manifest(**changes: object) -> Callable[[Members], bytes]:
    """A bundle whose manifest says something else."""
    return lambda members: zipped(with_json(members, lambda plain: plain.update(changes)))


def raw(change: Callable[[bytearray], None]) -> Callable[[Members], bytes]:
    def build(members: Members) -> bytes:
        content = bytearray(zipped(members))
        change(content)
        return bytes(content)

    return build


def lock(content: bytearray) -> None:
    content[content.index(b"PK\x01\x02") + 8] |= 1


def overlap(content: bytearray) -> None:
    first = content.index(b"PK\x01\x02")
    second = content.index(b"PK\x01\x02", first + 4)
    content[second + 42 : second + 46] = content[first + 42 : first + 46]


def link(members: Members) -> bytes:
    target = io.BytesIO(zipped(members))
    with zipfile.ZipFile(target, "a") as archive:
        info = zipfile.ZipInfo("source/link.py")
        info.create_system, info.external_attr = 3, 0o120777 << 16
        archive.writestr(info, b"/etc/passwd")
    return target.getvalue()


def added(name: str, content: bytes = b"x") -> Callable[[Members], bytes]:
    return lambda members: zipped({**members, name: content})


BUNDLES: dict[str, tuple[Callable[[Members], bytes], str]] = {
    # the zip
    "climbs out of its folder": (added("source/../../x"), "as none that"),
    "has a member that moves the cursor": (added("a\x1b[2Jb"), "as none that"),
    "has a member that nothing lists": (added("estimates/more.bin"), "does not list"),
    "has a source file that nothing lists": (added("source/more.py"), "the manifest lists"),
    "is a bomb": (lambda m: zipped(m | {"bomb.bin": bytes(5_000_000)}, zipfile.ZIP_DEFLATED), "compressed"),
    "is locked": (raw(lock), "encrypted"),
    "has members in one place": (raw(overlap), "overlaps|no bundle"),
    "is cut off": (lambda m: zipped(m)[:-40], "no bundle"),
    "links to a file of the reader": (link, "a link"),
    "is too large": (added("source/x.py", bytes(200_000)), "are allowed"),
    # what it says
    "is of yesterday": (manifest(schema=3), "schema"),
    "gives itself a tier": (manifest(tier="verified"), "tier"),
    "has other code than it says": (manifest(source={"submitted.py": "0" * 64}), "digest"),
    "has a card that is none": (lambda m: zipped(m | {"card.toml": b"name = 1"}), "digest"),
    "names code that is not there": (manifest(spec="elsewhere.py:Mine"), "neither travels with it"),
    "is nested without end": (
        lambda m: zipped(m | {"manifest.json": b'{"source":[{"a":' + b"[" * 9000}),
        "source|deep",
    ),
}


@pytest.mark.parametrize("name", BUNDLES)
def test_a_bundle_that_lies_is_refused(
    packed: Bundle, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    build, why = BUNDLES[name]
    monkeypatch.setattr(bundles, "MAX_SOURCE_BYTES", 100_000)
    members = members_of(packed)
    if name == "is too large":
        digest = hashlib.sha256(bytes(200_000)).hexdigest()
        members = with_json(members, lambda plain: plain["source"].update({"x.py": digest}))
    path = tmp_path / "x.pdrz"
    path.write_bytes(build(members))
    refusal = broken(path)
    assert refusal and any(part in refusal for part in why.split("|")), refusal
    assert refusal.isprintable()


def test_a_sound_bundle_is_the_same_bytes_and_a_device_is_not_read_to_its_end(packed: Bundle, tmp_path: Path) -> None:
    content = write_bundle(packed)
    again = read_bundle(content)
    assert again == packed and write_bundle(again) == content
    path = tmp_path / "x.pdrz"
    path.write_bytes(content)
    assert broken(path) == ""
    assert "it is no file" in broken(Path("/dev/zero"))


@hypothesis_settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_bytes_are_a_bundle_or_a_bundle_error(packed: Bundle, data: st.DataObject) -> None:
    changed = bytearray(write_bundle(packed))
    for _ in range(data.draw(st.integers(1, 4))):
        changed[data.draw(st.integers(0, len(changed) - 1))] = data.draw(st.integers(0, 255))
    cut = changed[: data.draw(st.integers(0, len(changed)))] if data.draw(st.booleans()) else changed
    try:
        read_bundle(bytes(cut))
    except BundleError as error:
        assert "\n" not in str(error)


def test_a_name_of_others_and_sensors_that_do_not_exist_are_refused(packed: Bundle, tmp_path: Path) -> None:
    path = tmp_path / "x.pdrz"
    for changes, why in (({"name": "stay"}, "is registered"), ({"sensors_used": ("radar",)}, "named radar")):
        changed = dataclasses.replace(packed, card=card_named(**({"name": "mine"} | changes)))
        path.write_bytes(write_bundle(changed))
        assert why in broken(path)


def test_what_a_stranger_wrote_is_printed_harmlessly(packed: Bundle, tmp_path: Path) -> None:
    """Control characters in a card are text of the card, and no command of a terminal."""
    path = tmp_path / "x.pdrz"
    card = card_named("mine", sensors_used=("po\x1b[2J\u202esition", "a\n| 1 | `b` |"))
    path.write_bytes(write_bundle(dataclasses.replace(packed, card=card)))
    for options in ((), ("--json",)):
        output = call("check", path, *options).output
        assert "sensors_used" in output
        assert all(sign.isprintable() or sign == "\n" for sign in output)


def test_card_pack_and_check_as_they_are_typed(mine: tuple[str, Path], tmp_path: Path) -> None:
    assert call("card", mine[0]).stdout.startswith('name = "mine"')
    out = tmp_path / "out.pdrz"
    packed = call("pack", mine[0], "--card", mine[1], "--out", out, "--json")
    assert json.loads(packed.stdout)["source"] == ["submitted.py"]
    assert call("check", out).exit_code == 0
    out.write_bytes(b"no zip")
    assert call("check", out).exit_code == 1


# Entries -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(played: Settings, tmp_path: Path) -> Path:
    """An entry that a maintainer has signed, whose key lies beside the boards; to be changed."""
    root = Path(shutil.copytree(played.root, tmp_path / "boards"))
    (root / "keys.toml").write_text(signing.new_key(tmp_path / "maintainer.key", "M. Aintainer", SINCE))
    sign_entry(root / "toy" / "mine", tmp_path / "maintainer.key")
    return root / "toy" / "mine"


def signed_file(folder: Path) -> dict[str, str]:
    found: dict[str, str] = json.loads((folder / "signed.json").read_text())
    return found


def write_signed(folder: Path, **changes: str) -> None:
    (folder / "signed.json").write_text(json.dumps(signed_file(folder) | changes))


def stranger(folder: Path) -> Path:
    """A key that its maker lists nowhere."""
    path = folder.parents[2] / "stranger.key"
    signing.new_key(path, "A. Stranger", SINCE)
    return path


def signed_by_stranger(folder: Path) -> None:
    sign_entry(folder, stranger(folder))


def strangers_name(folder: Path) -> None:
    name = signed_file(folder)["key"]
    signed_by_stranger(folder)
    write_signed(folder, key=name)


def other_keys(folder: Path, old: str, new: str) -> None:
    keys = folder.parents[1] / "keys.toml"
    keys.write_text(keys.read_text().replace(old, new))


def better_answers(folder: Path) -> None:
    path = folder / "answers.bin"
    path.write_bytes(path.read_bytes()[:-1] + b"x")


def better_scores(folder: Path) -> None:
    path = folder / "entry.json"
    path.write_text(re.sub(r'(?<="p75_m": \[)[\d.]+', "0.01", path.read_text(), count=1))


def one_score_more(folder: Path) -> None:
    path = folder / "entry.json"
    path.write_text(path.read_text().replace('"p75_m": [', '"p75_m": [0.01, ', 1))


def better_card(folder: Path) -> None:
    path = folder / "card.toml"
    path.write_text(path.read_text().replace("A. Author", "B. Author"))


def of_another(folder: Path) -> None:
    shutil.copy(folder.parent / "wanders" / "entry.json", folder)
    shutil.copy(folder.parent / "wanders" / "answers.bin", folder)
    shutil.copy(folder.parent / "wanders" / "card.toml", folder)


def record_of_another(folder: Path) -> None:
    body = json.loads(signed_file(folder)["body"]) | {"name": "wanders"}
    maintainer = folder.parents[2] / "maintainer.key"
    (folder / "signed.json").write_bytes(signing.sign(Verification(**(body | {"date": SINCE})), maintainer))


ENTRIES: dict[str, tuple[Callable[[Path], None], str]] = {
    "has no signature in its record": (lambda f: write_signed(f, signature="", key=""), "not signed"),
    "is signed by a stranger": (signed_by_stranger, "does not list"),
    "is signed by a stranger in another's name": (strangers_name, "not of this text"),
    "is signed with a revoked key": (
        lambda f: other_keys(f, "from =", "revoked = 2026-02-01\nfrom ="),
        "revoked on 2026-02-01",
    ),
    "is older than the key that signed it": (
        lambda f: other_keys(f, "from = 2026-01-01", "from = 2099-01-01"),
        "valid from 2099",
    ),
    "says something else than was signed": (
        lambda f: write_signed(f, body=signed_file(f)["body"].replace("mine", "wanders")),
        "not of this text",
    ),
    "has other answers": (better_answers, "not the one"),
    "has other scores than were signed": (better_scores, "before it was changed"),
    "has one score more than walks": (one_score_more, "one value of each metric"),
    "has another card than was signed": (better_card, "before it was changed"),
    "is the entry of another": (of_another, "lies in <board>/<entry>"),
    "has the record of another entry": (record_of_another, "another entry"),
}


@pytest.mark.parametrize("name", ENTRIES)
def test_an_entry_that_lies_is_refused(folder: Path, toy_board: Board, name: str) -> None:
    assert is_verified(folder, read_entry(folder)[0])
    change, why = ENTRIES[name]
    change(folder)
    with pytest.raises(BundleError, match=re.escape(why)) as refusal:
        is_verified(folder, read_entry(folder)[0])
    assert str(refusal.value).isprintable()
    with pytest.raises(BundleError):
        read_tables(folder.parents[1], toy_board)
    wrong = [found for found in check_board(folder.parents[1], toy_board) if not found.passed]
    assert any(why in found.why for found in wrong)


def test_keys_that_are_no_keys_are_refused(folder: Path) -> None:
    keys = folder.parents[1] / "keys.toml"
    good = keys.read_text()
    for bad in ("[x]\n", good.replace('public = "', 'public = "zz'), good + 'private = "x"\n', "[" * 5000):
        keys.write_text(bad)
        with pytest.raises(BundleError):
            is_verified(folder, read_entry(folder)[0])
    keys.unlink()
    with pytest.raises(BundleError):
        is_verified(folder, read_entry(folder)[0])


def test_a_private_key_is_its_owners_alone(tmp_path: Path) -> None:
    path = tmp_path / "k.key"
    assert 'owner = "A \\"B\\""' in signing.new_key(path, 'A "B"', SINCE)
    assert path.stat().st_mode & 0o777 == 0o600
    with pytest.raises(Exception, match="never replaces a file"):
        signing.new_key(path, "x", SINCE)
    path.chmod(0o640)
    with pytest.raises(BundleError, match="can be read by others"):
        signing.check_listed(path, tmp_path)
    path.chmod(0o600)
    for content in ("", "00", "zz" * 32, "0" * 63):
        path.write_text(content)
        with pytest.raises(BundleError, match="holds no private key"):
            signing.check_listed(path, tmp_path)
