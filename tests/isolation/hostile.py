"""Hostile localizers, one class a case. A test copies this file and writes paths and ports into its `TARGETS`.

Probes (`Probe`) report in their estimates: bit k of `x_m` is set where attempt k succeeded, in the order of `attempts`.
Whatever would harm a machine without protections is capped.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import functools
import gc
import importlib
import mmap
import os
import resource
import signal
import socket
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np

import pdrbench
from pdrbench.episode import EstimateRow
from pdrbench.errors import UnsuitableError
from pdrbench.isolation import messages
from pdrbench.localizer import Briefing, Estimate, Observation

TARGETS: dict[str, str] = {}  # replaced by the test
BAD_STEP = 3  # the observation at which a localizer shows what it is
MOST_FORKS, MOST_THREADS, MOST_FILES = 300, 3_000, 20_000
MOST_BYTES = 6 << 30
MEBIBYTE = 1 << 20
PLACES = (".", "~", "/tmp", "/var/tmp", "/dev/shm")
PTRACE_SEIZE, PTRACE_DETACH = 0x4206, 17
CLONE_NEWUSER, CLONE_NEWNS = 0x10000000, 0x00020000
KEYCTL_GET_KEYRING_ID = 0
NUMBERS = {
    "x86_64": {
        **{"bpf": 321, "keyctl": 250, "perf_event_open": 298, "io_uring_setup": 425, "ioprio_set": 251, "mincore": 27},
        **{"cachestat": 451, "inotify_init1": 294, "readahead": 187, "fadvise64": 221, "sysinfo": 99, "madvise": 28},
    }
}
PRIO_PGRP, PRIO_USER, IOPRIO_WHO_USER = 1, 2, 3
MADV_PAGEOUT, FADV_DONTNEED = 21, 4
MANY = 64  # numbers that a first process, or a first file, is not given


class Honest:
    """Adds up strides along x."""

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self.x_m, self.count, self.rng, self.briefing = 0.0, 0, rng, briefing

    def step(self, observation: Observation) -> Estimate:
        self.x_m += float(observation["stride"][:, 1].sum())
        self.count += 1
        if self.count == BAD_STEP + 1:
            found = self.misbehave()
            if found is not None:
                return found  # type: ignore[return-value]
        return Estimate(np.array([self.x_m, 0.0]), 0)

    def misbehave(self) -> object:
        return None


def define(base: type, method: str, table: dict[str, Callable[..., object]]) -> None:
    """One class for each attack of a table, which overrides one method."""
    for name, attack in table.items():
        globals()[name] = type(name, (base,), {method: attack, "__module__": __name__})


class HonestToo(Honest):
    """The same under another name: one stands between the others, one behind them."""


class HonestLast(Honest):
    """The same once more."""


def fail(error: Exception) -> object:
    raise error


def end_itself(call: Callable[..., None], *arguments: int) -> None:
    call(*arguments)
    time.sleep(60)


# --- answers that make no sense, or too much ---


ANSWERS: dict[str, Callable[..., object]] = {
    "Constant": lambda self, observation: Estimate(np.zeros(2), 0),
    "NotFinite": lambda self, observation: Estimate(np.array([np.nan, np.inf]), 0),
    "SaysNothing": lambda self, observation: None,
    "WrongShape": lambda self, observation: Estimate(np.zeros((3, 7)), 0),
    "Teleports": lambda self, observation: Estimate(self.rng.uniform(-1e6, 1e6, 2), int(self.rng.integers(-50, 50))),
    "SigmaZero": lambda self, observation: Estimate(Honest.step(self, observation).xy_m, 0, sigma_m=0.0),
    "SigmaHuge": lambda self, observation: Estimate(Honest.step(self, observation).xy_m, 0, sigma_m=1e9),
}
define(Honest, "step", ANSWERS)

ACTIONS: dict[str, Callable[..., object]] = {
    "HugeArray": lambda self: Estimate(np.zeros(1_000_000), 0),
    "Spins": lambda self: sum(iter(int, 1)),  # holds the interpreter in compiled code
    "ExitsHard": lambda self: os._exit(7),
    "ExitsAsIfNothing": lambda self: os._exit(0),
    "SegmentationFault": lambda self: ctypes.string_at(0),
    "KillsItself": lambda self: end_itself(os.kill, os.getpid(), signal.SIGKILL),
    "KillsItsGroup": lambda self: end_itself(os.killpg, 0, signal.SIGKILL),
    "StopsItself": lambda self: os.kill(os.getpid(), signal.SIGSTOP),  # neither ends nor runs on
    "RaisesWithoutEnd": lambda self: fail(ValueError("x" * (16 * MEBIBYTE))),
    "Declines": lambda self: fail(UnsuitableError("this walk is too hard")),
    "Colours": lambda self: fail(ValueError("\x1b[2J\x1b]0;owned\x07 \x9b31m gone")),  # would clear the terminal
    "ClosesEverything": lambda self: os.closerange(0, 256),
}
define(Honest, "misbehave", ACTIONS)
define(Honest, "__init__", {"NeverIsMade": lambda self: time.sleep(3600)})


class KillsItsParent(Honest):
    """In earnest, where there is one to be seen."""

    def misbehave(self) -> object:
        with contextlib.suppress(OSError):
            return os.kill(os.getppid(), signal.SIGKILL) if os.getppid() else None


class OddTypes(Honest):
    """Estimates with arbitrary fields."""

    def misbehave(self) -> object:
        odd = Estimate(np.zeros(2), 0)
        object.__setattr__(odd, "level", {"a": [object()] * 3})
        object.__setattr__(odd, "sigma_m", "wide")
        return odd


class Echo(Honest):
    """Repeats the answer before, whatever is observed."""

    def misbehave(self) -> object:
        self.step = lambda observation: Estimate(np.array([self.x_m, 0.0]), 0)  # type: ignore[method-assign]
        return None


class Extremes(Honest):
    """Extreme floats in every optional field."""

    def step(self, observation: Observation) -> Estimate:
        super().step(observation)
        size = (1e308, -1e308, 5e-324)[self.count % 3]
        return Estimate(np.array([size, -size]), 10**15, heading_rad=size, sigma_m=-size, converged=True)


class FutureDated(Honest):
    """A revised past that is the future."""

    def revise(self) -> np.ndarray:
        t_s = np.array([1e6, 2e6, 1e9])
        return np.column_stack([t_s, np.full((3, 2), 77.0), np.zeros(3)])


class PastWithoutEnd(Honest):
    """A revised past of 10 MB, for 13 observations."""

    def revise(self) -> np.ndarray:
        rows = np.zeros((300_000, 4))
        rows[:, 0] = np.arange(300_000) * 1e-5
        return rows


# --- time ---


class NeverAnswers(Honest):
    def misbehave(self) -> object:
        while True:
            with contextlib.suppress(BaseException):
                time.sleep(3600)


class Late(Honest):
    """Answers every observation, each later than there is time for."""

    def step(self, observation: Observation) -> Estimate:
        time.sleep(0.6)
        return super().step(observation)


class PatchesTime(Honest):
    """Stops every clock that Python has, and takes its time."""

    def misbehave(self) -> object:
        sleep = time.sleep
        for name in ("time", "monotonic", "perf_counter", "process_time"):
            setattr(time, name, lambda: 0.0)
            setattr(time, f"{name}_ns", lambda: 0)
        sleep(0.3)
        return None


# --- ends ---


class CannotBeTold(Honest):
    """An error that raises again when it is printed."""

    def misbehave(self) -> object:
        class Rude(Exception):
            def __str__(self) -> str:
                raise self

        raise Rude


# --- bombs ---


class ForkBomb(Honest):
    def misbehave(self) -> object:
        started = 0
        for _ in range(MOST_FORKS):
            with contextlib.suppress(OSError):
                if os.fork() == 0:
                    time.sleep(30)
                    os._exit(0)
                started += 1
        return Estimate(np.array([float(started), 0.0]), 0)


class MemoryBomb(Honest):
    def misbehave(self) -> object:
        held = [np.ones(32 * MEBIBYTE) for _ in range(MOST_BYTES // (256 * MEBIBYTE))]
        return Estimate(np.array([float(len(held)), 0.0]), 0)


class SharedMemoryBomb(Honest):
    """Shared memory that no other process maps and that counts as no process's private data."""

    def misbehave(self) -> object:
        with mmap.mmap(-1, MOST_BYTES) as held:
            for begin in range(0, MOST_BYTES, MEBIBYTE):
                held[begin : begin + MEBIBYTE] = bytes([1]) * MEBIBYTE
        return Estimate(np.array([float(MOST_BYTES), 0.0]), 0)


class ThreadBomb(Honest):
    def misbehave(self) -> object:
        done = threading.Event()
        started = 0
        with contextlib.suppress(RuntimeError):
            for _ in range(MOST_THREADS):
                threading.Thread(target=done.wait, daemon=True).start()
                started += 1
        done.set()
        return Estimate(np.array([float(started), 0.0]), 0)


class DiskFiller(Honest):
    """One file as large as may be."""

    def misbehave(self) -> object:
        written = fill(Path(tempfile.gettempdir()) / "large", MOST_BYTES)
        return Estimate(np.array([float(written), 0.0]), 0)


class DiskFillerOfManyFiles(Honest):
    def misbehave(self) -> object:
        written = 0
        for number in range(MOST_FILES):
            more = fill(Path(tempfile.gettempdir()) / f"small-{number}", MEBIBYTE)
            written += more
            if not more:
                break
        return Estimate(np.array([float(written), 0.0]), 0)


def fill(path: Path, most: int) -> int:
    written, block = 0, b"\1" * MEBIBYTE
    with contextlib.suppress(OSError), path.open("wb", buffering=0) as file:
        while written < most:
            written += file.write(block)
    return written


class DeepFolders(Honest):
    """Nested folders, deeper than a recursive cleanup can descend."""

    def misbehave(self) -> object:
        os.chdir(tempfile.gettempdir())
        for _ in range(1_200):
            with contextlib.suppress(OSError):
                os.mkdir("a-long-name")  # noqa: PTH102
                os.chdir("a-long-name")
        return None


class PlantsLinks(Honest):
    """Links from its scratch folder to the results, and folders without permissions."""

    def misbehave(self) -> object:
        scratch = Path(tempfile.gettempdir())
        with contextlib.suppress(OSError):
            (scratch / "results").symlink_to(TARGETS["results"])
            (scratch / "data").symlink_to(TARGETS["data_file"])
            (scratch / "locked").mkdir(mode=0)
            (scratch / "open").mkdir()
            (scratch / "open" / "results").symlink_to(TARGETS["results"])
            (scratch / "open" / "locked").mkdir(mode=0)
        return None


class OpensFiles(Honest):
    """As many descriptors as there are."""

    def misbehave(self) -> object:
        opened = []
        with contextlib.suppress(OSError):
            for _ in range(1 << 20):
                opened.append(os.open("/dev/null", os.O_RDONLY))
        for handle in opened:
            os.close(handle)
        return Estimate(np.array([float(len(opened)), 0.0]), 0)


class LeavesDaemons(Honest):
    """Children of children in sessions of their own, which outlive the walk, and a thread that does not end."""

    def misbehave(self) -> object:
        threading.Thread(target=time.sleep, args=(3600,), daemon=False).start()
        with contextlib.suppress(OSError):
            if os.fork() == 0:
                os.setsid()
                if os.fork() == 0:
                    time.sleep(120)
                os._exit(0)
        return None


# --- words ---


class Floods(Honest):
    """Writes to standard output for ever, and never answers."""

    def misbehave(self) -> object:
        block = bytes(range(256)) * 4096
        while True:
            os.write(1, block)


class Garbage(Honest):
    """Ten megabytes on standard output and error."""

    def misbehave(self) -> object:
        block = bytes(range(256)) * 4096
        for _ in range(5):
            os.write(1, block)
            os.write(2, block)
        print("the end of the garbage", flush=True)
        return None


class GarbageEverywhere(Honest):
    """Ten bytes on every descriptor there is."""

    def misbehave(self) -> object:
        for handle in range(256):
            with contextlib.suppress(OSError):
                os.write(handle, b"\xff\xfe\xfd garbage"[:10])
        return None


class ReadsEverything(Honest):
    """Removes files that others read."""

    def misbehave(self) -> object:
        for handle in range(3, 64):
            with contextlib.suppress(OSError):
                os.set_blocking(handle, False)
                os.read(handle, 4096)
        return None


# --- forged replies ---


class Forger(Honest):
    """Writes to the descriptor of the replies itself."""

    rests_s = 0.0  # after that, so that what it wrote is read before its own reply comes

    def misbehave(self) -> object:
        handle, number = self.pipe()
        for part in self.bytes(number):
            left = memoryview(part)
            while left:
                left = left[os.write(handle, left) :]
        time.sleep(self.rests_s)
        return None

    def pipe(self) -> tuple[int, int]:
        """Descriptor of the replies and number of the request, from the frames that wait for this one."""
        handle, number = -1, -1
        frame = sys._getframe()
        while frame is not None:
            here = frame.f_locals
            handle = here["replies"] if isinstance(here.get("replies"), int) else handle
            number = getattr(here.get("request"), "number", number)
            frame = frame.f_back  # type: ignore[assignment]
        return handle, number

    def bytes(self, number: int) -> Iterator[bytes]:
        raise NotImplementedError


def reply_to(number: int) -> bytes:
    return bytes(messages.frame(messages.Answer(number, EstimateRow(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))))


def framed(body: bytes) -> bytes:
    return len(body).to_bytes(4, "little") + body


class ForgerThatRests(Forger):
    rests_s = 5.0


define(
    Forger,
    "bytes",
    {
        "Twice": lambda self, number: [reply_to(number)],
        "Ahead": lambda self, number: [reply_to(number) + reply_to(number + 1)],  # and the observation to come
    },
)
define(
    ForgerThatRests,
    "bytes",
    {
        "WrongStep": lambda self, number: [reply_to(number + 1)],
        "WrongKind": lambda self, number: [bytes(messages.frame(messages.Done(number)))],
        "NotSixNumbers": lambda self, number: [framed(msgspec.msgpack.encode(["answer", number, [0.0, 0.0, 0.0]]))],
        "DeepNesting": lambda self, number: [framed(b"\x91" * 60_000)],
        "NoMessage": lambda self, number: [framed(bytes(range(100, 200)))],
        "HalfReply": lambda self, number: [reply_to(number)[:10]],  # announces more than comes
    },
)


class GigabyteReply(Forger):
    def bytes(self, number: int) -> Iterator[bytes]:
        yield (1 << 30).to_bytes(4, "little")
        for _ in range(1024):
            yield bytes(MEBIBYTE)


class Drips(Forger):
    """One byte at a time, for ever: something always comes."""

    def bytes(self, number: int) -> Iterator[bytes]:
        yield (50_000).to_bytes(4, "little")
        while True:
            yield b"\x00"
            time.sleep(0.02)


# --- doors ---


class Probe(Honest):
    """Attempts forbidden operations; its estimates report which succeeded."""

    found = 0

    def attempts(self) -> dict[str, Callable[[], object]]:
        return {}

    def step(self, observation: Observation) -> Estimate:
        super().step(observation)
        return Estimate(np.array([float(self.found), 0.0]), 0)

    def misbehave(self) -> object:
        for bit, attempt in enumerate(self.attempts().values()):
            with contextlib.suppress(Exception, SystemExit):
                if attempt():
                    self.found |= 1 << bit
        return Estimate(np.array([float(self.found), 0.0]), 0)


def can_open(path: str | Path, flags: int = os.O_RDONLY) -> bool:
    os.close(os.open(path, flags))
    return True


def processes() -> list[int]:
    """Processes worth an attack: the parent, the test, and every other visible one."""
    seen = []
    with contextlib.suppress(OSError):
        seen = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    wanted = {os.getppid(), int(TARGETS["pid"]), *seen[:64], *seen[-64:]}
    return sorted(wanted - {0, os.getpid()})


def libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def is_let_in(name: str, *arguments: object) -> bool:
    """True where a system call was not refused, whatever its outcome."""
    numbers = NUMBERS.get(os.uname().machine, {})
    ctypes.set_errno(0)
    return name in numbers and (
        libc().syscall(numbers[name], *arguments) >= 0
        or ctypes.get_errno() not in (errno.EPERM, errno.EACCES, errno.ENOSYS)
    )


class ReadsData(Probe):
    def attempts(self) -> dict[str, Callable[[], object]]:
        return {
            "data": lambda: can_open(TARGETS["data_file"]),
            "data-listed": lambda: list(Path(TARGETS["data"]).iterdir()),
            "secret": lambda: can_open(TARGETS["secret_file"]),
            "results": lambda: can_open(next(Path(TARGETS["results"]).iterdir())),
            "environment": lambda: can_open(TARGETS["env_source"]),
            "simulator": lambda: can_open(TARGETS["simulator_source"]),
            "simulator-compiled": lambda: can_open(TARGETS["simulator_compiled"]),
            "plugin": lambda: can_open(TARGETS["plugin_source"]),
            "homes": lambda: [*Path("/root").iterdir(), *Path("/home").iterdir()],
            "shadow": lambda: can_open("/etc/shadow"),
        }


class ReadsMemory(Probe):
    def attempts(self) -> dict[str, Callable[[], object]]:
        return {
            "mem-file": lambda: any(self.memory_file(pid) for pid in processes()),
            "process_vm_readv": lambda: any(self.process_vm_readv(pid) for pid in processes()),
            "ptrace": lambda: any(self.ptrace(pid) for pid in processes()),
            "dev-mem": lambda: can_open("/dev/mem") or can_open("/proc/kcore"),
        }

    def memory_file(self, pid: int) -> bool:
        with contextlib.suppress(OSError):
            return can_open(f"/proc/{pid}/mem")
        return False

    def process_vm_readv(self, pid: int) -> bool:
        """One byte of the other's program: its address is ours, as both run the same interpreter, or else a fault."""
        buffer = ctypes.create_string_buffer(8)
        here = struct.pack("PN", ctypes.addressof(buffer), 8)
        address = ctypes.cast(libc().getpid, ctypes.c_void_p).value
        there = struct.pack("PN", address, 8)
        ctypes.set_errno(0)
        got = libc().process_vm_readv(pid, here, 1, there, 1, 0)
        return bool(got >= 0 or ctypes.get_errno() == 14)  # EFAULT: allowed, with nothing at that address

    def ptrace(self, pid: int) -> bool:
        if libc().ptrace(PTRACE_SEIZE, pid, 0, 0) != 0:
            return False
        libc().ptrace(PTRACE_DETACH, pid, 0, 0)
        return True


class OpensSockets(Probe):
    def attempts(self) -> dict[str, Callable[[], object]]:
        return {
            "tcp": lambda: self.connects(socket.AF_INET, ("127.0.0.1", int(TARGETS["port"]))),
            "udp": lambda: self.sends_to(("127.0.0.1", int(TARGETS["udp_port"]))),
            "unix": lambda: self.connects(socket.AF_UNIX, TARGETS["unix"]),
            "abstract": lambda: self.connects(socket.AF_UNIX, "\0" + TARGETS["abstract"]),
            "listen": lambda: self.listens(),
            "pair": lambda: self.sends_over_a_pair(socket.SOCK_DGRAM),
            "pair-of-packets": lambda: self.sends_over_a_pair(socket.SOCK_SEQPACKET),
            "pair-descriptor": lambda: self.sends_descriptor(),
        }

    def sends_over_a_pair(self, kind: int) -> bool:
        """A datagram socket that was never bound nor connected reaches any address."""
        ours, _ = socket.socketpair(socket.AF_UNIX, kind)
        ours.sendto(b"the truth", TARGETS["unix_datagram"])
        return True

    def sends_descriptor(self) -> bool:
        ours, _ = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, struct.pack("i", os.open(".", os.O_RDONLY)))]
        return ours.sendmsg([b"the truth"], rights, 0, TARGETS["unix_datagram"]) > 0

    def connects(self, family: int, address: object) -> bool:
        with socket.socket(family, socket.SOCK_STREAM) as caller:
            caller.settimeout(1.0)
            caller.connect(address)  # type: ignore[arg-type]
        return True

    def sends_to(self, address: tuple[str, int]) -> bool:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as caller:
            caller.sendto(b"the truth", address)
        return False  # whether it arrived is for the test to see

    def listens(self) -> bool:
        with socket.create_server(("127.0.0.1", 0)):
            return True


class EditsEvaluator(Probe):
    """Opens files of the evaluator for writing, without writing."""

    def attempts(self) -> dict[str, Callable[[], object]]:
        core = Path(pdrbench.__file__)
        return {
            "pdrbench": lambda: can_open(core, os.O_RDWR),
            "numpy": lambda: can_open(np.__file__, os.O_RDWR),
            "pdrbench-new": lambda: can_open(core.with_name("planted.py"), os.O_RDWR | os.O_CREAT),
            "results-new": lambda: can_open(Path(TARGETS["results"]) / "planted.result", os.O_RDWR | os.O_CREAT),
            "results": lambda: can_open(next(Path(TARGETS["results"]).glob("*.result")), os.O_RDWR),
            "numba": lambda: can_open(Path(TARGETS["numba"]) / "planted", os.O_RDWR | os.O_CREAT),
            "itself": lambda: can_open(__file__, os.O_RDWR),
            "home": lambda: can_open(Path(TARGETS["home"]) / "planted", os.O_RDWR | os.O_CREAT),
            "shm": lambda: can_open(Path("/dev/shm") / f"planted-{os.getpid()}", os.O_RDWR | os.O_CREAT),
        }


class ImportsEnvironment(Probe):
    """Any process with the code and the walk's name can generate the walk again."""

    def attempts(self) -> dict[str, Callable[[], object]]:
        return {
            "ours": lambda: importlib.import_module("pdrbench_envs.office_stride"),
            "simulator": lambda: importlib.import_module("pdrbench_sim.people.walk"),
            "plugin": lambda: importlib.import_module("corridor_plugin"),
            "loads-ours": lambda: self.loads("OfficeStride-v0"),
            "loads-plugin": lambda: self.loads("Corridor-v0"),
        }

    def loads(self, env: str) -> bool:
        from pdrbench.registry import make_task

        task = make_task(env)
        return bool(task.load(task.walks["test"][0]).reference)


class WalksMemory(Probe):
    """Every object that the interpreter and its frames refer to."""

    def attempts(self) -> dict[str, Callable[[], object]]:
        return {"types": self.by_type, "frames": self.by_frames, "rows": self.rows_ahead}

    def by_type(self) -> bool:
        names = {"Recording", "Episode", "Task", "Job", "JobContext", "Item", "Setting", "Result"}
        return any(type(thing).__name__ in names and "pdrbench" in type(thing).__module__ for thing in gc.get_objects())

    def by_frames(self) -> bool:
        words = {"recording", "episode", "task", "reference", "truth", "secret", "setting", "item"}
        frames = list(sys._current_frames().values())
        while frames:
            frame = frames.pop()
            if words & set(frame.f_locals):
                return True
            if frame.f_back is not None:
                frames.append(frame.f_back)
        return False

    def rows_ahead(self) -> bool:
        """An array with the times of every stride of the walk: 1, 2, ..., 12 s."""
        arrays = [thing for thing in gc.get_objects() if isinstance(thing, np.ndarray) and thing.ndim == 2]
        return any(len(rows) >= 12 and rows[-1, 0] == 12.0 for rows in arrays)


class ReadsSecrets(Probe):
    def attempts(self) -> dict[str, Callable[[], object]]:
        return {
            "own-variables": lambda: TARGETS["secret"] in str(dict(os.environ)) or "PDRBENCH_DATA" in os.environ,
            "environ": lambda: self.stands_in("environ"),
            "cmdline": lambda: self.stands_in("cmdline"),
            "own-environ": lambda: TARGETS["secret"].encode() in Path("/proc/self/environ").read_bytes(),
        }

    def stands_in(self, file: str) -> bool:
        for pid in processes():
            with contextlib.suppress(OSError):
                if TARGETS["secret"].encode() in Path(f"/proc/{pid}/{file}").read_bytes():
                    return True
        return False


class Remembers(Probe):
    """Leaves a note wherever it can, for a later walk or another localizer."""

    def attempts(self) -> dict[str, Callable[[], object]]:
        notes = {place: Path(place).expanduser() / f"note-{index}" for index, place in enumerate(PLACES)}
        return {place: functools.partial(self.note, note) for place, note in notes.items()}

    def note(self, path: Path) -> bool:
        found = path.exists()
        with contextlib.suppress(OSError):
            path.write_text("it was at (3, 4)")
        return found


class Counts(Probe):
    """Reads and sets what the machine keeps when a process ends: what one walk counts up, the next can read."""

    def attempts(self) -> dict[str, Callable[[], object]]:
        words = ctypes.create_string_buffer(4096)
        library = ctypes.c_void_p(ctypes.cast(libc().malloc, ctypes.c_void_p).value & ~4095)  # type: ignore[operator]
        return {
            "process-number": lambda: os.getpid() > MANY,
            "thread-number": lambda: threading.get_native_id() > MANY,
            "file-number": lambda: self.number_of_a_file() > MANY,
            "pipe-number": lambda: os.fstat(os.pipe()[0]).st_ino,
            "last-process": lambda: can_open("/proc/sys/kernel/ns_last_pid"),
            "load": lambda: can_open("/proc/loadavg"),
            "load-by-call": lambda: is_let_in("sysinfo", words),
            "forks": lambda: can_open("/proc/stat"),
            "memory": lambda: can_open("/proc/meminfo"),
            "pages": lambda: can_open("/proc/vmstat"),
            "open-files": lambda: can_open("/proc/sys/fs/file-nr"),
            "entries": lambda: can_open("/proc/sys/fs/dentry-state"),
            "randomness": lambda: can_open("/proc/sys/kernel/random/entropy_avail"),
            "control-group": lambda: any(map(can_open, Path("/sys/fs/cgroup").glob("*stat*"))),
            "node": lambda: can_open("/sys/devices/system/node/node0/vmstat"),
            "idle": lambda: any(map(can_open, Path("/sys/devices/system/cpu/cpu0").rglob("usage"))),
            "pages-of-a-file": lambda: is_let_in("mincore", library, 4096, words),
            "cache-of-a-file": lambda: self.with_library("cachestat", words, words, 0),
            "fetches": lambda: self.with_library("readahead", 0, 4096),
            "evicts": lambda: self.with_library("fadvise64", 0, 0, FADV_DONTNEED),
            "evicts-mapped": lambda: is_let_in("madvise", library, 4096, MADV_PAGEOUT),
            "watches": lambda: is_let_in("inotify_init1", 0),
        }

    def number_of_a_file(self) -> int:
        Path("file").touch()
        return Path("file").stat().st_ino

    def with_library(self, call: str, *arguments: object) -> bool:
        with Path(np.__file__).open("rb") as file:
            return is_let_in(call, file.fileno(), *arguments)


class RemembersToo(Remembers):
    """Looks for the notes of the other."""


class SignalsOthers(Probe):
    def attempts(self) -> dict[str, Callable[[], object]]:
        nice = os.getpriority(os.PRIO_PROCESS, 0)
        return {
            "kill": lambda: any(self.reaches(pid) for pid in processes()),
            "nice-user": lambda: libc().setpriority(PRIO_USER, os.getuid(), nice) == 0,
            "nice-group": lambda: libc().setpriority(PRIO_PGRP, 0, nice) == 0,
            "nice-parent": lambda: libc().setpriority(os.PRIO_PROCESS, os.getppid(), nice) == 0,
            "io-priority": lambda: is_let_in("ioprio_set", IOPRIO_WHO_USER, os.getuid(), 0),
        }

    def reaches(self, pid: int) -> bool:
        with contextlib.suppress(OSError):
            os.kill(pid, 0)  # nothing is sent
            return True
        return False


class Escapes(Probe):
    """Ways out of limits and namespaces."""

    def attempts(self) -> dict[str, Callable[[], object]]:
        unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
        return {
            "file-size": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, unlimited) is None,
            "memory": lambda: resource.setrlimit(resource.RLIMIT_DATA, unlimited) is None,
            "unshare": lambda: libc().unshare(CLONE_NEWUSER | CLONE_NEWNS) == 0,
            "mount": lambda: libc().mount(b"none", b"/tmp", b"tmpfs", 0, None) == 0,
            "chroot": lambda: libc().chroot(b".") == 0,
            "setns": lambda: libc().setns(os.open("/proc/1/ns/mnt", os.O_RDONLY), 0) == 0,
            "bpf": lambda: is_let_in("bpf", 0, ctypes.create_string_buffer(64), 64),
            "keyctl": lambda: is_let_in("keyctl", KEYCTL_GET_KEYRING_ID, -3, 1),
            "io_uring": lambda: is_let_in("io_uring_setup", 4, ctypes.create_string_buffer(256)),
            "perf": lambda: is_let_in("perf_event_open", ctypes.create_string_buffer(128), 0, -1, -1, 0),
        }
