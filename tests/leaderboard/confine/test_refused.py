"""Where the system refuses a protection, or the user is unprivileged, walks are played and the record says so.

Every walk is played in a fork of this process in which a seccomp filter, such as a container's, refuses calls; its
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

from pdrbench.evaluation.process_run import play_in_child
from pdrbench.evaluation.walk_job import plan_walks
from pdrbench.process.budget import Budget
from pdrbench_leaderboard.confine import seccomp
from pdrbench_leaderboard.confine.boot import CLONE
from pdrbench_leaderboard.confine.confine import _drop_capabilities
from pdrbench_leaderboard.confine.launcher_client import discard

pytestmark = [
    pytest.mark.confinement,
    pytest.mark.skipif(platform.machine() not in seccomp.ARCHITECTURES, reason="the filter knows no such processor"),
]
ALLOW, REFUSE = seccomp.ALLOW, seccomp.ERRNO
SET_NO_NEW_PRIVS, SET_SECCOMP = 38, 22  # of prctl
NAMESPACES = {f"namespace-{kind}" for kind in ("user", "mount", "pid", "net", "ipc", "uts")}
# Calls by their numbers on x86-64 and aarch64: what is refused, with which error, and what is missing then.
UNSHARE, SET_ATTRIBUTES, MAKE_RULESET, SECCOMP = (272, 97), (442, 442), (444, 444), (317, 277)
REFUSED: dict[str, tuple[list[tuple[int, int]], int, set[str]]] = {
    "namespaces": ([UNSHARE], errno.EPERM, NAMESPACES),
    "mounts": ([SET_ATTRIBUTES], errno.ENOSYS, {"files-read-only"}),
}
NEEDED: dict[str, tuple[tuple[int, int], int]] = {
    "landlock-files": (MAKE_RULESET, errno.ENOSYS),
    "seccomp": (SECCOMP, errno.EINVAL),
}
UNPRIVILEGED = 65_534
ENV = "Toy-v1"


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


def play() -> Played:
    """A walk as a worker plays it."""
    options: dict[str, Any] = {"budget": Budget(), "isolation": "confined"}
    (job,) = plan_walks({ENV: ["stay"]}, split="val", seeds=[0], walks=1, parameters={}, **options)
    result = play_in_child(job, {}, io.BytesIO())
    isolation: Any = result.provenance["isolation"]
    return Played(result.status, result.failure, result.estimates.xy_m.tobytes(), **isolation)


def in_fork(prepare: Callable[[], object]) -> Played:
    """A walk in a fork of this process, after `prepare`."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            prepare()
            report_bytes = msgspec.msgpack.encode(play())
            discard()
        except Skip as skip:
            report_bytes = msgspec.msgpack.encode(str(skip))
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
    if isinstance(played, str):
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
    return in_fork(lambda: None)


@pytest.mark.parametrize("what", REFUSED)
def test_refused_calls_are_recorded_and_the_walk_is_the_same(what: str, usual: Played) -> None:
    calls, code, expected = REFUSED[what]
    played = in_fork(lambda: refuse(calls, code))
    assert (played.status, played.failure) == ("complete", "")
    assert played.xy_m == usual.xy_m
    assert expected <= played.missing.keys()
    assert not expected & set(played.held)
    assert {played.missing[name] for name in expected & set(usual.held)} <= {os.strerror(code)}
    lost = {name for name in usual.held if name not in played.held}
    depends = {"files-read-only", "scratch-limited", "proc-own", "data-hidden", "walk-alone"}
    assert lost <= expected | depends, "the others hold as before"
    assert ("namespaces" in played.mode) == bool(NAMESPACES & set(played.held))


@pytest.mark.parametrize("what", NEEDED)
def test_without_what_keeps_files_and_networks_shut_nothing_is_played(what: str, usual: Played) -> None:
    call, code = NEEDED[what]
    if what not in usual.held:
        pytest.skip(f"this system has no {what}")
    played = in_fork(lambda: refuse([call], code))
    assert played.status == "failed"
    assert f"confinement was asked for, and the system denies {what}" in played.failure
    assert not played.xy_m


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
    assert (played.status, played.failure) == ("complete", "")
    assert played.xy_m == usual.xy_m
    assert {"no-new-privileges", "no-capabilities", "process-group", "limit-memory"} <= set(played.held)
    assert {*played.held, *played.missing} >= {*usual.held}, "whatever is missing is recorded"
    assert all(played.missing.values())
