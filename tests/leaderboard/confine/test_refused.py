"""Where the system refuses a protection nothing is played; an unprivileged user plays as root does.

Everything happens in a fork of this process in which a seccomp filter, such as a container's, refuses calls; its
launcher and its child inherit the filter.
"""

from __future__ import annotations

import ctypes
import errno
import io
import os
import platform
import struct
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.evaluation.process_run import play_in_child
from pdrbench.evaluation.walk_job import plan_walks
from pdrbench.process.budget import Budget
from pdrbench.task import commitment
from pdrbench_leaderboard.boards import Board, Round
from pdrbench_leaderboard.confine import seccomp
from pdrbench_leaderboard.confine.boot import CLONE
from pdrbench_leaderboard.confine.confine import _drop_capabilities
from pdrbench_leaderboard.confine.launcher_client import discard
from pdrbench_leaderboard.run import Settings, run

pytestmark = [
    pytest.mark.confinement,
    pytest.mark.skipif(platform.machine() not in seccomp.ARCHITECTURES, reason="the filter knows no such processor"),
]
ALLOW, REFUSE = seccomp.ALLOW, seccomp.ERRNO
SET_NO_NEW_PRIVS, SET_SECCOMP = 38, 22  # of prctl
# Calls by their numbers on x86-64 and aarch64, and what is missing where they are refused
SECCOMP = (317, 277)
REFUSED: dict[str, tuple[tuple[int, int], str]] = {
    "namespaces": ((272, 97), "namespace-pid"),
    "landlock": ((444, 444), "landlock-files"),
    "seccomp": (SECCOMP, "seccomp"),
    "mounts": ((442, 442), "files-read-only"),
}
KINDS = ("namespaces", "landlock", "seccomp")
UNPRIVILEGED = 65_534
SKIP = "cannot be tried: "
ENV = "Toy-v1"
SECRET = "c105ed" * 8
CLOSED = Round(number=1, commitment=commitment(SECRET))


class Skip(Exception):
    """This system cannot try it."""


class Played(msgspec.Struct):
    """The outcome of a walk."""

    status: str
    failure: str
    xy_m: bytes
    mode: str
    held: list[str]
    missing: dict[str, str]


def play() -> Played | str:
    """A walk as a worker plays it."""
    options: dict[str, Any] = {"budget": Budget(), "isolation": "confined"}
    try:
        (job,) = plan_walks({ENV: ["stay"]}, split="val", seeds=[0], walks=1, parameters={}, **options)
    except PdrbenchError as error:
        return str(error)
    result = play_in_child(job, {}, io.BytesIO())
    isolation: Any = result.provenance["isolation"]
    return Played(result.status, result.failure, result.estimates.xy_m.tobytes(), **isolation)


def in_fork(prepare: Callable[[], object], act: Callable[[], Played | str] = play) -> Played | str:
    """A walk, or what else is done, in a fork of this process, after `prepare`."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            prepare()
            report_bytes = msgspec.msgpack.encode(act())
            discard()
        except Skip as skip:
            report_bytes = msgspec.msgpack.encode(f"{SKIP}{skip}")
        except BaseException:  # noqa: BLE001  reported by the parent
            report_bytes = traceback.format_exc().encode()
        with os.fdopen(writing, "wb") as report:
            report.write(report_bytes)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as report:
        report_bytes = report.read()
    os.waitpid(child, 0)
    try:
        played: Played | str = msgspec.msgpack.decode(report_bytes, type=Played | str)
    except msgspec.DecodeError:
        raise AssertionError(report_bytes.decode()) from None
    if isinstance(played, str) and played.startswith(SKIP):
        pytest.skip(played)
    return played


def refuse(calls: list[tuple[int, int]], code: int) -> None:
    """From now on the kernel refuses these calls to this process and its children; filters also by way of prctl."""
    column = list(seccomp.ARCHITECTURES).index(platform.machine())
    rules = [(seccomp.LOAD, 0, 0, seccomp.NUMBER_AT)]
    for call in calls:
        rules += [(seccomp.JUMP_EQUAL, 0, 1, call[column]), (seccomp.RETURN, 0, 0, REFUSE | code)]
    if SECCOMP in calls:
        rules += [(seccomp.JUMP_EQUAL, 0, 3, seccomp.PRCTL[column]), (seccomp.LOAD, 0, 0, seccomp.ARGUMENT_AT)]
        rules += [(seccomp.JUMP_EQUAL, 0, 1, SET_SECCOMP), (seccomp.RETURN, 0, 0, REFUSE | code)]
    rules.append((seccomp.RETURN, 0, 0, ALLOW))
    libc = ctypes.CDLL(None, use_errno=True)
    filters = seccomp._Program(len(rules), b"".join(struct.pack("<HBBI", *rule) for rule in rules))
    assert libc.prctl(SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
    assert libc.prctl(SET_SECCOMP, seccomp.MODE_FILTER, ctypes.byref(filters), 0, 0) == 0, os.strerror(
        ctypes.get_errno()
    )


@pytest.fixture(scope="module")
def usual() -> Played:
    found = in_fork(lambda: None)
    assert isinstance(found, Played)
    return found


def verify(board: Board, spec: str, card: Path, root: Path) -> str:
    """The error by which verification of a stranger's code ends; neither secret nor key can be read."""
    nowhere = root / "nowhere"
    settings = Settings(root=root, work=root, round=CLOSED, secret=nowhere / "secret", key=nowhere / "key")
    try:
        list(run([board], [spec], settings, card=card))
    except PdrbenchError as error:
        return str(error)
    return "verified"


@pytest.mark.parametrize("what", [*((name,) for name in REFUSED), KINDS], ids="+".join)
def test_verification_is_refused_and_neither_secret_nor_key_is_read(
    what: tuple[str, ...], usual: Played, toy_board: Board, mine: tuple[str, Path], tmp_path: Path
) -> None:
    assert {REFUSED[name][1] for name in what} <= set(usual.held), "it holds on this system"
    calls = [REFUSED[name][0] for name in what]
    found = in_fork(lambda: refuse(calls, errno.EPERM), lambda: verify(toy_board, *mine, tmp_path))
    assert isinstance(found, str)
    assert "confinement was asked for, and the system denies" in found
    assert any(REFUSED[name][1] in found for name in what)


def test_a_registered_localizer_is_played_without_any_of_them(toy_board: Board, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text(SECRET)

    def run_stay() -> str:
        settings = Settings(root=tmp_path, work=tmp_path, round=CLOSED, secret=secret, walks=1, isolation="none")
        return str([of.played for of in run([toy_board], ["stay"], settings)])

    calls = [REFUSED[name][0] for name in KINDS]
    assert in_fork(lambda: refuse(calls, errno.EPERM), run_stay) == str([("stay",), ("stay",)])


def lose_rights() -> None:
    """The same user, under another number and without the rights of root, in a namespace of its own."""
    uid, gid = os.getuid(), os.getgid()
    if ctypes.CDLL(None, use_errno=True).unshare(CLONE["namespace-user"]):
        raise Skip(f"no namespaces of users: {os.strerror(ctypes.get_errno())}")
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"{UNPRIVILEGED} {uid} 1")
    Path("/proc/self/gid_map").write_text(f"{UNPRIVILEGED} {gid} 1")
    _drop_capabilities()
    assert os.getuid() == UNPRIVILEGED
    with pytest.raises(PermissionError):
        os.chroot("/")


def test_a_normal_user_plays_walks_as_root_does(usual: Played) -> None:
    if os.getuid():
        pytest.skip(f"user {os.getuid()} is a normal user already: all other tests show it")
    played = in_fork(lose_rights)
    assert isinstance(played, Played)
    assert (played.status, played.failure) == ("complete", "")
    assert played.xy_m == usual.xy_m
    assert {"no-new-privileges", "no-capabilities", "process-group", "limit-memory"} <= set(played.held)
    assert {*played.held, *played.missing} >= {*usual.held}, "whatever is missing is recorded"
    assert all(played.missing.values())
