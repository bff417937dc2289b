"""Effects of the protections, tested in separate processes; where the system lacks one, the test says so."""

from __future__ import annotations

import ctypes
import errno
import os
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path

import pytest

from pdrbench.registry import PluginError
from pdrbench_leaderboard.confine import seccomp
from pdrbench_leaderboard.confine.boot import ProtectionRecord
from pdrbench_leaderboard.confine.confine import FileLimits, close_others, confine, detach
from pdrbench_leaderboard.confine.landlock import Ruleset, version
from pdrbench_leaderboard.confine.read_permissions import environment_packages, hidden_places, permissions_of

pytestmark = pytest.mark.confinement
resource = pytest.importorskip("resource")

linux_only = pytest.mark.skipif(sys.platform != "linux", reason="Landlock, namespaces and seccomp are Linux's")
PID = 4711


def in_fork(act: Callable[[], None]) -> None:
    """Runs `act` in a fork of this process and fails where it does."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            act()
        except BaseException:  # noqa: BLE001  reported by the parent
            os.write(writing, traceback.format_exc().encode()[-8000:])
            os._exit(1)
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as report:
        traceback_text = report.read()
    _, status = os.waitpid(child, 0)
    assert not traceback_text, traceback_text
    assert os.waitstatus_to_exitcode(status) == 0


def denied(act: Callable[[], object], *codes: int) -> None:
    try:
        act()
    except OSError as error:
        assert error.errno in (codes or (errno.EPERM, errno.EACCES)), error
    else:
        raise AssertionError("no protection stopped it")


def verdict(machine: str, number: int, *arguments: int, architecture: int | None = None) -> int:
    """The filter's verdict on a call, by an interpreter of its five instructions."""
    word = seccomp.ARCHITECTURES[machine] if architecture is None else architecture
    data = {seccomp.NUMBER_AT: number, seccomp.ARCHITECTURE_AT: word}
    data |= {seccomp.ARGUMENT_AT + 8 * index: value & 0xFFFFFFFF for index, value in enumerate(arguments)}
    upper = seccomp.ARGUMENT_AT + seccomp.UPPER_HALF
    data |= {upper + 8 * index: value >> 32 & 0xFFFFFFFF for index, value in enumerate(arguments)}
    place, accumulator = 0, 0
    instructions = seccomp.program(machine, PID)
    while True:
        code, if_true, if_false, operand = instructions[place]
        place += 1
        if code == seccomp.LOAD:
            accumulator = data.get(operand, 0)
        elif code == seccomp.RETURN:
            return operand
        else:
            holds = {
                seccomp.JUMP_EQUAL: accumulator == operand,
                seccomp.JUMP_AT_LEAST: accumulator >= operand,
                seccomp.JUMP_ANY_BIT: bool(accumulator & operand),
            }[code]
            place += if_true if holds else if_false


DENY = seccomp.ERRNO | errno.EPERM


OWN = {**seccomp.ONLY_OWN, **seccomp.SIGNALS}
CLOCK = -2 & 0xFFFFFFFF  # that of a process
# Of each class of attack some calls: sockets, pipes, processes, pages in memory, counters, limits, locks, keys, mounts.
REFUSED = {
    **{"socket": (41, 198), "socketpair": (53, 199), "sendmsg": (46, 211), "pipe2": (293, 59), "execve": (59, 221)},
    **{"pidfd_open": (434, 434), "ptrace": (101, 117), "process_vm_readv": (310, 270), "mincore": (27, 232)},
    **{"preadv2": (327, 286), "getrusage": (98, 165), "io_setup": (206, 0), "io_uring_setup": (425, 425)},
    **{"statfs": (137, 43), "sysinfo": (99, 179), "setrlimit": (160, 164), "flock": (73, 32), "keyctl": (250, 219)},
    **{"mount": (165, 40), "unshare": (272, 97), "bpf": (321, 280), "perf_event_open": (298, 241), "shmget": (29, 194)},
    **{"mq_open": (240, 180), "timer_create": (222, 107), "userfaultfd": (323, 282), "memfd_create": (319, 279)},
    **{"vmsplice": (278, 75), "splice": (275, 76), "setxattr": (188, 5), "mlock": (149, 228), "personality": (135, 92)},
    **{"rt_sigqueueinfo": (129, 138), "seccomp": (317, 277), "futex_wake": (454, 454), "landlock_add_rule": (445, 445)},
}


@pytest.mark.parametrize("machine", seccomp.ARCHITECTURES)
def test_the_filter_allows_what_is_listed_and_nothing_else(machine: str) -> None:
    column = list(seccomp.ARCHITECTURES).index(machine)
    listed = {numbers[column] for numbers in seccomp.ALLOWED.values()} - {-1}
    partly = {numbers[column] for numbers, _ in seccomp.conditions(PID)}
    for number in range(1000):
        if number not in partly:
            denied_by = seccomp.ERRNO | errno.ENOSYS if number >= seccomp.FIRST_NEW else DENY
            assert verdict(machine, number) == (seccomp.ALLOW if number in listed else denied_by), number
    assert not listed & partly
    assert len(listed) == sum(numbers[column] >= 0 for numbers in seccomp.ALLOWED.values()), "no number twice"
    assert len(partly) == len(seccomp.conditions(PID))
    assert not {numbers[column] for numbers in REFUSED.values()} & (listed | partly)
    assert len(seccomp.program(machine, PID)) < 4096, "the most that the kernel takes"


@pytest.mark.parametrize("machine", seccomp.ARCHITECTURES)
def test_the_filter_separates_what_is_its_own_from_what_others_see(machine: str) -> None:
    column = list(seccomp.ARCHITECTURES).index(machine)

    def allows(numbers: tuple[int, int], *arguments: int) -> bool:
        found = verdict(machine, numbers[column], *arguments)
        assert found in (seccomp.ALLOW, DENY)
        return found == seccomp.ALLOW

    assert allows(seccomp.CLONE, 0x3D0F00), "the flags with which glibc makes a thread"
    assert not allows(seccomp.CLONE, signal.SIGCHLD)
    assert verdict(machine, seccomp.CLONE3[column]) == seccomp.ERRNO | errno.ENOSYS, "glibc then takes clone"
    for priority in seccomp.PRIORITY:
        assert [allows(priority, which, who) for which in (0, 1, 2) for who in (0, PID, 1)] == [True, True] + 7 * [
            False
        ]
    assert [allows(seccomp.MADVISE, 0, 0, how) for how in (4, 8, 14, 3, 12, 21, 22, 25)] == 3 * [True] + 5 * [False]
    assert [allows(seccomp.PRCTL, option) for option in (15, 1, 4, 67, 22)] == [True] + 4 * [False]
    assert [allows(seccomp.FCNTL, 3, what) for what in (1, 3, 1030, 6, 37, 1024, 1026, 1031)] == 3 * [True] + 5 * [
        False
    ]
    assert [allows(seccomp.IOCTL, 3, what) for what in (0x5401, 0x40086602, 0x5412)] == [True, False, False]
    for clock in seccomp.CLOCKS:
        assert [allows(clock, which) for which in (0, 1, 2, 3, CLOCK)] == 4 * [True] + [False]
    private, shared = 129, 1
    assert [allows(seccomp.FUTEX, 0, how) for how in (private, 0, 9, 265, shared, 3, 4, 6)] == 4 * [True] + 4 * [False]
    assert allows(seccomp.MMAP, 0, 4096, 3, 0x22)
    assert allows(seccomp.MMAP, 0, 4096, 1, 0x01), "of a file, which may be a large one"
    assert [allows(seccomp.MMAP, 0, 4096, 3, flags) for flags in (0x21, 0x23, 0x40022)] == [False] * 3
    assert allows(seccomp.PRLIMIT, 0, 7, 0)
    assert [allows(seccomp.PRLIMIT, *request) for request in ((0, 7, 1), (0, 7, 1 << 32), (1, 7, 0))] == [False] * 3
    for name, numbers in OWN.items():
        assert allows(numbers, PID), name
        assert not allows(numbers, PID + 1), name
        assert not allows(numbers, -1), name
        assert allows(numbers, 0) == (name in seccomp.ONLY_OWN), name


def test_another_architecture_ends_the_process_and_another_interface_is_denied() -> None:
    assert verdict("x86_64", 39, architecture=0x40000003) == seccomp.KILL, "32-bit calls have other numbers"
    assert verdict("x86_64", 0x40000000 | 41) == DENY


@linux_only
def test_calls_that_are_not_listed_fail_and_ordinary_work_goes_on(tmp_path: Path) -> None:
    (tmp_path / "file").touch()

    def act() -> None:
        record = ProtectionRecord()
        confine(record, None)
        if "seccomp" not in record.held:
            return
        denied(os.fork)
        denied(lambda: os.execv("/bin/true", ["true"]))
        denied(lambda: socket.socket(socket.AF_INET))
        denied(lambda: socket.socket(socket.AF_UNIX))
        denied(lambda: os.kill(os.getppid(), 0))
        denied(lambda: os.kill(0, signal.SIGTERM))
        denied(lambda: (tmp_path / "file").chmod(0))
        denied(lambda: os.setsid())
        denied(lambda: resource.prlimit(os.getppid(), resource.RLIMIT_NOFILE))
        denied(lambda: os.sched_setaffinity(os.getppid(), {0}))
        assert ctypes.CDLL(None).ptrace(16, os.getppid(), 0, 0) == -1
        os.kill(os.getpid(), 0)
        resource.getrlimit(resource.RLIMIT_NOFILE)
        done: list[int] = []
        thread = threading.Thread(target=done.append, args=(1,))
        thread.start()
        thread.join()
        assert done == [1]
        assert (tmp_path / "file").read_text() == ""

    in_fork(act)


@linux_only
def test_only_what_is_listed_can_be_opened(tmp_path: Path) -> None:
    try:
        abi = version()
    except OSError as error:
        pytest.skip(f"no Landlock: {error}")
    for name in ("readable", "scratch", "data"):
        (tmp_path / name / "deep").mkdir(parents=True)
        (tmp_path / name / "deep" / "file").write_text(name)
    single = tmp_path / "data" / "single"
    single.write_text("single")

    def act() -> None:
        ruleset = Ruleset()
        ruleset.read(str(tmp_path / "readable"))
        ruleset.read(str(single))
        ruleset.write(str(tmp_path / "scratch"))
        ruleset.list_folder(str(tmp_path))
        record = ProtectionRecord()
        confine(record, ruleset)
        assert "landlock-files" in record.held
        assert (tmp_path / "readable" / "deep" / "file").read_text() == "readable"
        assert single.read_text() == "single"
        assert {path.name for path in (tmp_path / "data").iterdir()} == {"deep", "single"}
        denied(lambda: (tmp_path / "data" / "deep" / "file").read_text())
        denied(lambda: (tmp_path / "readable" / "deep" / "file").write_text("changed"))
        denied(lambda: (tmp_path / "readable" / "deep" / "file").unlink())
        denied(lambda: (tmp_path / "new").mkdir())
        denied(lambda: Path("/proc/self/environ").read_text())
        moved = tmp_path / "data" / "moved"
        denied(lambda: (tmp_path / "scratch" / "deep" / "file").rename(moved), errno.EACCES, errno.EXDEV)
        (tmp_path / "scratch" / "new").write_text("mine")
        if abi >= 3:
            denied(lambda: os.truncate(single, 0))

    in_fork(act)


@linux_only
def test_root_without_capabilities_cannot_open_files_of_others(tmp_path: Path) -> None:
    if os.getuid():
        pytest.skip("not root")
    secret = tmp_path / "secret"
    secret.write_text("x")
    os.chown(secret, 1, 1)
    secret.chmod(0o600)

    def act() -> None:
        assert secret.read_text() == "x"
        record = ProtectionRecord()
        confine(record, None)
        if "no-capabilities" in record.held:
            denied(secret.read_text)

    in_fork(act)


def test_limits_are_set_for_good_and_only_the_pipes_stay_open() -> None:
    def act() -> None:
        kept, lost = os.open(os.devnull, os.O_RDONLY), os.open(os.devnull, os.O_RDONLY)
        record = ProtectionRecord()
        detach(record, FileLimits(file_mb=1, open_files=64), memory_mb=4096, cpu_s=100.0)
        assert {"limit-memory", "limit-cpu", "limit-file-size", "limit-open-files", "limit-core"} <= set(record.held)
        assert resource.getrlimit(resource.RLIMIT_FSIZE) == (1 << 20, 1 << 20)
        core = resource.getrlimit(resource.RLIMIT_CORE)[0]
        assert core in (0, 1), "less than a page; 1 keeps programs that collect crashes out, too"
        assert os.getpgid(0) == os.getpid()
        close_others([kept])
        os.fstat(kept)
        denied(lambda: os.fstat(lost), errno.EBADF)

    in_fork(act)


def covers(readable: tuple[str, ...], path: Path) -> bool:
    place = os.path.realpath(path)
    return any(place == root or place.startswith(f"{root}{os.sep}") for root in readable)


def test_no_environment_and_no_data_is_readable(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A localizer from a file may read itself, Python and the toolbox."""
    file = tmp_path / "mine.py"
    file.write_text("")
    data = tmp_path / "lib" / "data"
    data.mkdir(parents=True)
    (tmp_path / "lib" / "package").mkdir()
    (tmp_path / "lib" / "package" / "__init__.py").touch()
    (tmp_path / "lib" / "results").mkdir()
    monkeypatch.setenv("PDRBENCH_DATA", str(data))
    monkeypatch.syspath_prepend(str(tmp_path / "lib"))
    allowed = permissions_of(str(file), f"{file}:Mine")
    import numpy

    import pdrbench_envs
    import pdrbench_sim
    from pdrbench import filters

    assert {"pdrbench_envs", "pdrbench_sim"} <= environment_packages()
    for module in (pdrbench_envs, pdrbench_sim):
        assert not covers(allowed.readable, Path(str(module.__file__)))
    for module in (numpy, filters, os, ctypes):
        assert covers(allowed.readable, Path(str(module.__file__))), module
    assert covers(allowed.readable, file) and covers(allowed.readable, tmp_path / "lib" / "package")
    for outside in (file.parent, data, tmp_path / "lib" / "results", Path.home(), Path("/etc/passwd"), Path("/proc/1")):
        assert not covers(allowed.readable, outside), outside
    assert os.path.realpath(data) in hidden_places()


def test_a_localizer_in_a_package_with_environments_is_refused() -> None:
    with pytest.raises(PluginError, match="'pdrbench_envs' registers environments"):
        permissions_of("pdrbench_envs.x:Y", "pdrbench_envs.x:Y")
