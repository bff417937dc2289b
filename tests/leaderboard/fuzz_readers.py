"""Coverage-guided fuzzing of everything that reads submitted files: only the documented error may come out.

    python tests/leaderboard/fuzz_readers.py TARGET [--seconds N] [--seed N] [--corpus FOLDER]

Needs atheris. An input on which anything else escapes is written as `crash-*` into the corpus folder's parent, or here.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import hashlib
import io
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["pdrbench_leaderboard", "pdrbench.process", "zipfile", "tomllib"]):
    import zipfile

    import numpy as np
    from pdrbench_leaderboard.locked import lock_text, parse_lock
    from pdrbench_leaderboard.wheel_unpacking import WheelError
    from pdrbench_leaderboard.wheel_unpacking import unpack as unpack_wheel

    from pdrbench.episode import EstimateRow, read_estimate
    from pdrbench.errors import BundleError, EstimateError, PdrbenchError
    from pdrbench.process import messages
    from pdrbench.trajectory import ESTIMATE_COLUMNS
    from pdrbench_leaderboard import coding
    from pdrbench_leaderboard.bundle import read_bundle, write_bundle, write_members
    from pdrbench_leaderboard.card import EXAMPLE, card_toml, read_card
    from pdrbench_leaderboard.entry import Submission
    from pdrbench_leaderboard.folder_archive import Archive, read_archive, unpack
    from pdrbench_leaderboard.manifest import Manifest, RunRecord
    from pdrbench_leaderboard.schema import read_json, read_toml, write_json
    from pdrbench_leaderboard.signing import CONTEXT, PublicKey, Signed, key_id, new_key, read_keys, sign, signed_text
    from pdrbench_leaderboard.verification import HeldOut, Verification, read_verification

from example_bundle import LOCALIZER_FOLDER, LOCK, example  # type: ignore[import-not-found]  # beside this script

MAX_BYTES = 1 << 16
MEMORY_MB = 3_000  # of which the interpreter and its libraries take 300
PLACE = "/dev/shm" if Path("/dev/shm").is_dir() else None  # for what is unpacked
SECONDS_FOR_ONE = 10  # an input that takes longer is a finding


FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-keys-"))
KEY = FOLDER / "maintainer.key"
(FOLDER / "keys.toml").write_text(new_key(KEY, "fuzz", datetime.date(2026, 1, 1)))
KEYS = read_keys(FOLDER)
SOUND = example()
SOUND_BYTES = write_bundle(SOUND)
VERIFICATION = Verification(
    schema=1,
    suite="pdr-core-v2",
    env="OfficeStride-v2",
    localizer="mine-v0",
    entry_sha256=SOUND.entries()[0].sha256,
    tier="verified",
    date=datetime.date(2026, 2, 1),
    nonce="0123456789abcdef" * 2,
    reran=2,
    of=2,
    is_deterministic=True,
    core_sha256=SOUND.manifest.core_sha256,
    localizer_sha256=SOUND.manifest.localizer_sha256,
    versions={"pdrbench": "0"},
    machine={"cores": 2},
    isolation=({"mode": "process"},),
    runs=SOUND.run.walks["OfficeStride-v2"],
    held_out=HeldOut(
        round="ab" * 32,
        estimates_sha256="cd" * 32,
        seeds=1,
        statuses="cd",
        units=(0, 1),
        values={"p75_level_penalised_m": (1.0, 2.0), "mean_m": (None, 0.5)},
    ),
)
SIGNED = [write_json(VERIFICATION)]
with zipfile.ZipFile(io.BytesIO(SOUND_BYTES)) as archive:
    MEMBERS = {name: archive.read(name) for name in archive.namelist()}


def read_whole_bundle(content: bytes) -> None:
    """The bytes unchanged."""
    with contextlib.suppress(PdrbenchError):
        read_bundle(content).entries()


def read_changed_member(content: bytes) -> None:
    """A sound zip, one member of which is the input; digests in the manifest are corrected to match."""
    names = sorted(MEMBERS)
    if not content:
        return
    name, changed = names[content[0] % len(names)], content[1:]
    members = MEMBERS | {name: changed}
    if name == "card.toml":
        digest = hashlib.sha256(changed).hexdigest().encode()
        members["manifest.json"] = members["manifest.json"].replace(SOUND.manifest.card_sha256.encode(), digest)
    if name.startswith("estimates/"):
        try:
            whole, _ = coding.decode(changed, name)
        except BundleError:
            return
        manifest = members["manifest.json"]
        for walk, path in zip(SOUND.manifest.environments[0].walks, names[1:], strict=False):
            if path == name:
                manifest = manifest.replace(walk.sha256.encode(), coding.digest(whole).encode())
                manifest = manifest.replace(b'"rows": 20', b'"rows": %d' % whole.shape[1])
        members["manifest.json"] = manifest
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_STORED) as file:
        for path, member in members.items():
            file.writestr(zipfile.ZipInfo(path), member)
    read_whole_bundle(packed.getvalue())


def read_estimates(content: bytes) -> None:
    try:
        whole, end = coding.decode(content, "fuzz")
    except BundleError:
        return
    assert end <= len(content)
    assert whole.shape[0] == len(ESTIMATE_COLUMNS)
    kept = coding.whole_numbers(coding.from_whole_numbers(whole, 0.5))
    assert np.array_equal(kept, whole), "what was read is what would be written"


def read_one_card(content: bytes) -> None:
    try:
        card = read_card(content)
    except BundleError:
        return
    assert read_card(card_toml(card)) == card


def read_records(content: bytes) -> None:
    for kind in (Manifest, RunRecord, Submission, Verification):
        try:
            record = read_json(content, kind, "fuzz")
        except BundleError:
            continue
        assert read_json(write_json(record), kind, "fuzz") == record
        if isinstance(record, RunRecord):
            for walks in record.walks.values():
                for walk in walks:
                    assert len(coding.times(walk.step_times, 1000)) == 1000


def read_signed(content: bytes) -> None:
    """A file that may be signed, and a text that a maintainer has signed."""
    with contextlib.suppress(BundleError):
        text, _ = signed_text(content, KEYS, "fuzz")
        assert text in map(bytes.decode, SIGNED), "nothing else was signed"
    with contextlib.suppress(BundleError, UnicodeDecodeError):
        read_verification(sign_text(content.decode()), KEYS, "fuzz")


def sign_text(text: str) -> bytes:
    """A file with a true signature of any text."""
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    private = Ed25519PrivateKey.from_private_bytes(bytes.fromhex(KEY.read_text().strip()))
    signature = private.sign(CONTEXT + text.encode()).hex()
    return write_json(Signed(body=text, key=key_id(KEY), signature=signature))


def read_key_tables(content: bytes) -> None:
    with contextlib.suppress(BundleError):
        keys = read_toml(content, dict[str, PublicKey], "keys.toml")
        with contextlib.suppress(BundleError):
            signed_text(sign(VERIFICATION, KEY), keys, "fuzz")


KINDS = (messages.Confined, messages.Ready, messages.Done, messages.Answer | messages.Missing, messages.Track)


def read_replies(content: bytes) -> None:
    """A frame as the evaluating side takes it from its pipe."""
    try:
        size = messages.frame_size(content[:4], messages.MAX_REPLY_BYTES)
        if size is None or len(content) < size:
            return
    except messages.ProtocolError:
        pass
    body = content[messages.LENGTH_BYTES :]
    for kind in KINDS:
        try:
            reply = messages.read_reply(body, 1, kind)  # type: ignore[arg-type]
            if isinstance(reply, messages.Answer):
                with contextlib.suppress(EstimateError):
                    read_estimate(reply.claims)
        except messages.ProtocolError:
            continue


def _unpack_nowhere_else(archive: Archive) -> None:
    """A folder that could be read is unpacked; nothing is written beside it."""
    with tempfile.TemporaryDirectory(dir=PLACE) as place:
        with contextlib.suppress(BundleError):
            unpack(archive, Path(place) / "folder")
        assert {path.name for path in Path(place).iterdir()} <= {"folder"}


def read_folder(content: bytes) -> None:
    """A folder as it travels: the bytes unchanged, and as the one that is named by the first of them."""
    with contextlib.suppress(BundleError):
        _unpack_nowhere_else(read_archive(content))
    names = sorted(LOCALIZER_FOLDER)
    if content:
        changed = {**LOCALIZER_FOLDER, names[content[0] % len(names)]: content[1:]}
        with contextlib.suppress(BundleError):
            _unpack_nowhere_else(read_archive(write_members(changed)))


def read_lock(content: bytes) -> None:
    try:
        locked = parse_lock(content, "fuzz")
    except BundleError:
        return
    assert parse_lock(lock_text(locked).encode(), "fuzz") == locked


def read_wheel(content: bytes) -> None:
    with tempfile.TemporaryDirectory(dir=PLACE) as place:
        (Path(place) / "packages").mkdir()
        with contextlib.suppress(WheelError, OSError):  # the system's own: a name that is too long
            unpack_wheel(io.BytesIO(content), "fuzz", Path(place) / "packages", 1 << 20)
        assert [path.name for path in Path(place).iterdir()] == ["packages"]


TARGETS: dict[str, Callable[[bytes], None]] = {
    "bundle": read_whole_bundle,
    "member": read_changed_member,
    "estimates": read_estimates,
    "card": read_one_card,
    "records": read_records,
    "replies": read_replies,
    "signed": read_signed,
    "keys": read_key_tables,
    "folder": read_folder,
    "lock": read_lock,
    "wheel": read_wheel,
}


def seeds(target: str) -> list[bytes]:
    """Sound inputs to begin with."""
    names = sorted(MEMBERS)
    replies = (
        messages.Confined(1, ["seccomp"], {"landlock-files": "not on this system"}),
        messages.Ready(1, True, False),
        messages.Done(1),
        messages.Answer(1, EstimateRow(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        messages.Missing(1, "nan"),
        messages.Track(1, np.zeros((2, 6))),
        messages.Failed(1, False, "Traceback"),
    )
    submission = Submission(manifest=SOUND.manifest, run=SOUND.run, content_sha256=SOUND.content_sha256)
    return {
        "bundle": [SOUND_BYTES],
        "member": [bytes([names.index(name)]) + content for name, content in MEMBERS.items()],
        "estimates": [coding.encode(whole) for whole in SOUND.estimates],
        "card": [card_toml(EXAMPLE)],
        "records": [write_json(SOUND.manifest), write_json(SOUND.run), write_json(submission)],
        "replies": [bytes(messages.frame(reply)) for reply in replies],
        "signed": [sign(VERIFICATION, KEY), *SIGNED],
        "keys": [(FOLDER / "keys.toml").read_bytes()],
        "folder": [
            write_members(LOCALIZER_FOLDER),
            *(bytes([at]) + LOCALIZER_FOLDER[name] for at, name in enumerate(sorted(LOCALIZER_FOLDER))),
        ],
        "lock": [LOCK],
        "wheel": [write_members({"foreign.py": b"", "foreign-1.data/purelib/x.py": b"x", "a/b.pth": b"import os"})],
    }[target]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("target", choices=sorted(TARGETS))
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--runs", type=int, default=-1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--corpus", type=Path, help="Kept between runs; a new one where none is named.")
    given = parser.parse_args()
    corpus = given.corpus or Path(tempfile.mkdtemp(prefix="fuzz-"))
    corpus.mkdir(parents=True, exist_ok=True)
    for number, content in enumerate(seeds(given.target)):
        (corpus / f"seed-{number}").write_bytes(content)
    options = [
        f"-max_total_time={given.seconds}",
        f"-runs={given.runs}",
        f"-seed={given.seed}",
        f"-max_len={MAX_BYTES}",
        f"-rss_limit_mb={MEMORY_MB}",
        f"-timeout={SECONDS_FOR_ONE}",
        f"-artifact_prefix={corpus.parent}/{given.target}-",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], *options, str(corpus)], TARGETS[given.target])
    atheris.Fuzz()


if __name__ == "__main__":
    main()
