"""Hostile localizers: each is contained, its result says what happened, and no other localizer's walk is lost.

Sweeps run in a process of their own, whose orphans become children of the test, so that it sees what is left.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import shutil
import socket
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from installed import declare
from numba.core import caching

import pdrbench_envs
import pdrbench_sim
from pdrbench.evaluation import store
from pdrbench.result import COMPLETE, FAILED, Result

HERE = Path(__file__).parent
PLUGIN = HERE.parents[1] / "evaluation" / "plugin" / "corridor_plugin.py"
FILES_OF = {"AtImport": "at_import", "NoPython": "no_python"}  # the others are in the package `hostile`
STEPS = 13  # observations of a walk along the corridor
MIN_LOCALIZERS = 60
SECRET = "b3f1-the-truth"
SCRIPT = """
import json, sys
order = json.loads(sys.argv[1])
sys.path[:] = order["path"]
from pdrbench.evaluation import evaluate
from pdrbench.process import Budget
for sweep in order["sweeps"]:
    results = evaluate(**sweep, envs="Corridor-v0", seeds=1, isolation="confined", budget=Budget(**order["budget"]))
    assert len(results.rows()) == len(sweep["localizers"]), "every localizer has scores"
"""

pytestmark = pytest.mark.confinement


def hostile_package() -> Any:
    """The registry of hostile localizers, from the folder beside this file."""
    folder = HERE / "hostile"
    spec = importlib.util.spec_from_file_location("hostile", folder / "__init__.py")
    assert spec is not None and spec.loader is not None
    sys.modules["hostile"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["hostile"])
    return importlib.import_module("hostile.registry")


REGISTRY = hostile_package()
LOCALIZERS, PROBES = REGISTRY.localizers(), REGISTRY.probes()
BAD_STEP = importlib.import_module("hostile.common").BAD_STEP  # estimates before it are those of a harmless localizer
TWO_PASS = importlib.import_module("hostile.two_pass")
BUDGET = {"pace": 0.1, "slack_s": 1.0, "start_s": 15.0}  # of a step: 0.1 s, and a second for the walk


@dataclass(frozen=True)
class World:
    """Where things are in the test's world."""

    root: Path
    path: tuple[str, ...]

    @property
    def out(self) -> Path:
        return self.root / "out"

    @property
    def temporary(self) -> Path:
        return self.root / "tmp"


@contextlib.contextmanager
def doors(root: Path) -> Iterator[dict[str, socket.socket]]:
    """A process that listens on every kind of socket."""
    tcp = socket.create_server(("127.0.0.1", 0))
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.bind(("127.0.0.1", 0))
    unix = socket.socket(socket.AF_UNIX)
    unix.bind(str(root / "unix"))
    unix.listen()
    datagrams = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    datagrams.bind(str(root / "datagrams"))
    opened = {"tcp": tcp, "udp": udp, "unix": unix, "datagrams": datagrams}
    if sys.platform == "linux":
        opened["abstract"] = socket.socket(socket.AF_UNIX)
        opened["abstract"].bind(f"\0pdrbench-test-{os.getpid()}")
        opened["abstract"].listen()
    for door in opened.values():
        door.setblocking(False)
    try:
        yield opened
    finally:
        for door in opened.values():
            door.close()


def compiled_simulator() -> Path:
    """Where Numba keeps the compiled functions of a folder of the simulator."""
    folder = Path(pdrbench_sim.__file__).parent / "people"
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if not chosen:
        return folder / "__pycache__"
    locator: Any = caching.UserProvidedCacheLocator  # the one that looks at the variable
    return Path(chosen) / locator.get_suitable_cache_subpath(str(folder / "walk.py"))


def make_world(root: Path, opened: Mapping[str, socket.socket]) -> World:
    site, data, home = root / "site", root / "data", root / "home"
    for folder in (site, data, home, root / "localizers", root / "out", root / "tmp"):
        folder.mkdir()
    shutil.copy(PLUGIN, site)
    declare(site, "corridor-plugin", "[pdrbench.environments]\nx = corridor_plugin:ENVIRONMENTS\n")
    for secret in (data / "truth.csv", root / "secret.txt", root / "removable.txt"):
        secret.write_text(SECRET)
    targets = {
        "pid": str(os.getpid()),
        "data": str(data),
        "data_file": str(data / "truth.csv"),
        "secret_file": str(root / "secret.txt"),
        "results": str(root / "out"),
        "env_source": str(Path(pdrbench_envs.__file__).parent / "campus" / "environment.py"),
        "simulator_source": str(Path(pdrbench_sim.__file__).parent / "people" / "walk.py"),
        "plugin_source": str(site / PLUGIN.name),
        "numba": os.environ.get("NUMBA_CACHE_DIR", str(home)),
        "home": str(home),
        "port": str(opened["tcp"].getsockname()[1]),
        "udp_port": str(opened["udp"].getsockname()[1]),
        "unix": str(root / "unix"),
        "unix_datagram": str(root / "datagrams"),
        "simulator_compiled": str(compiled_simulator() / f"planted-{os.getpid()}"),
        "abstract": f"pdrbench-test-{os.getpid()}",
        "secret": SECRET,
        "removable": str(root / "removable.txt"),
    }
    assert all(Path(targets[name]).is_file() for name in targets if name.endswith(("_source", "_file")))
    shutil.copytree(HERE / "hostile", root / "localizers" / "hostile", ignore=shutil.ignore_patterns("__pycache__"))
    (root / "localizers" / "hostile" / "targets.py").write_text(f"TARGETS = {targets!r}\n")
    (root / "localizers" / "at_import.py").write_text("import os\nos._exit(9)\n")
    (root / "localizers" / "no_python.py").write_bytes(b"class NoPython(\xff\x00")
    return World(root, (str(site), str(root / "localizers"), *sys.path))


def sweep(world: World, sweeps: Mapping[str, tuple[Sequence[str], int, int]]) -> dict[str, list[Result]]:
    """The stored results of sweeps in one process, which must succeed whatever its localizers do.

    Args:
        world: Where they are.
        sweeps: Localizers, number of walks and jobs by the name of their folder.
    """
    order = {
        "path": world.path,
        "budget": BUDGET,
        "sweeps": [
            {
                "localizers": [where(world, name) for name in names],
                "walks": walks,
                "jobs": jobs,
                "out": str(world.root / out),
            }
            for out, (names, walks, jobs) in sweeps.items()
        ],
    }
    dirs = {"PDRBENCH_DATA": str(world.root / "data"), "TMPDIR": str(world.temporary), "HOME": str(world.root / "home")}
    ended = subprocess.run(
        [sys.executable, "-c", SCRIPT, json.dumps(order), SECRET],
        env=os.environ | dirs | {"PDRBENCH_TEST_SECRET": SECRET},
        capture_output=True,
        timeout=280,
        start_new_session=True,
    )
    assert ended.returncode == 0, ended.stderr.decode(errors="replace")[-4000:]
    found = {out: [store.load(path) for path in sorted((world.root / out).glob(f"*{store.SUFFIX}"))] for out in sweeps}
    assert {out: len(of) for out, of in found.items()} == {out: len(of[0]) * of[1] for out, of in sweeps.items()}
    return found


def where(world: World, name: str) -> str:
    """A localizer as a user names it."""
    if name in FILES_OF:
        return f"{world.root}/localizers/{FILES_OF[name]}.py:{name}"
    return f"{LOCALIZERS[name].__module__ if name in LOCALIZERS else 'hostile.harmless'}:{name}"


def name_of(result: Result) -> str:
    return result.localizer.rpartition(":")[2]


# --- what is expected ---

Says = Callable[[Result], object]


def last_line(result: Result) -> str:
    return result.failure.strip().splitlines()[-1] if result.failure else ""


def failed(*words: str, answered: Sequence[int] = (BAD_STEP,)) -> Says:
    """The walk failed, says why in its last line, and keeps earlier estimates."""

    def says(result: Result) -> None:
        assert result.status == FAILED, (result.status, dict(result.missing))
        assert any(word in last_line(result) for word in words), f"{last_line(result)!r} has none of {words}"
        assert len(result.failure) < 50_000
        assert len(result.estimates) in answered

    return says


def complete(**missing: int) -> Says:
    def says(result: Result) -> None:
        assert result.status == COMPLETE, result.failure
        assert len(result.estimates) == STEPS
        assert dict(result.missing) == missing

    return says


def either(if_complete: Says, if_not: Says) -> Says:
    """As the one or the other comes first."""
    return lambda result: (if_complete if result.status == COMPLETE else if_not)(result)


def contained(most: float) -> Says:
    """At most `most` was reached (reported as `x_m`), or the walk was ended, possibly a few steps late."""

    def says(result: Result) -> None:
        assert result.status in (COMPLETE, FAILED)
        assert len(result.estimates) >= BAD_STEP
        for reached in result.estimates.xy_m[BAD_STEP : BAD_STEP + 1, 0].tolist():
            assert reached <= most

    return says


AT_ONCE_OR_NEXT = (BAD_STEP, BAD_STEP + 1)  # as the one or the other is read first
TIMEOUT, DIED, PROTOCOL = "timeout", "process died", "protocol error"
SAYS: dict[str, Says] = {
    # answers that make no sense, or too much
    "NotFinite": failed("first 10 answers cannot be meant", answered=[10]),
    "SaysNothing": failed("first 10 answers cannot be meant", answered=[10]),
    "WrongShape": failed("first 10 answers cannot be meant", answered=[10]),
    "OddTypes": complete(type=1),
    "Extremes": complete(),
    "FutureDated": complete(),
    "PastWithoutEnd": failed(PROTOCOL, answered=[STEPS]),
    # ends
    "ExitsAsIfNothing": failed("exit code (0)"),
    "AtImport": failed("exit code (9)", answered=[0]),
    "NoPython": failed("cannot be loaded", answered=[0]),
    "KillsItsParent": complete(),
    "RaisesWithoutEnd": failed("ValueError", "xxxx"),
    "CannotBeTold": failed("Rude", "RecursionError", "exception str() failed", DIED),
    "Colours": failed("ValueError"),
    "Declines": failed("this walk is too hard"),
    # in the hope of a second pass
    "KillsItself": failed("SIGKILL"),
    "RunsOutOfProcessorTime": failed("SIGXCPU"),
    "LosesItsFile": failed("SIGBUS"),
    "CallsAnotherInterface": failed("SIGSYS", "exit code (5)"),
    "OverwritesItsMemory": failed("SIGSEGV"),
    "ClosesItsReplies": failed("ended", DIED),
    "StartsAnew": failed("PermissionError", TIMEOUT, "ended"),
    "DiesOfItsBriefing": failed("SIGKILL", answered=[0]),
    "DiesWhenMade": failed("SIGKILL", answered=[0]),
    "DiesAtTheEnd": failed("SIGKILL", answered=[STEPS - 1]),
    # forged replies
    "Twice": failed(PROTOCOL, answered=AT_ONCE_OR_NEXT),
    "WrongStep": failed(PROTOCOL),
    "NotSixNumbers": failed(PROTOCOL),
    "GigabyteReply": failed(PROTOCOL),
    "NoMessage": failed(PROTOCOL),
    # words
    "Garbage": complete(),
    "GarbageEverywhere": failed(PROTOCOL),
    "ReadsEverything": either(complete(), failed("exit code (1)", TIMEOUT, answered=range(BAD_STEP, STEPS + 1))),
    # bombs
    "ForkBomb": contained(0.0),
    "ThreadBomb": contained(2_000.0),
    "DiskFillerOfManyFiles": contained(256.0 * (1 << 20)),
    "OpensFiles": contained(1024.0),
    "DeepFolders": either(complete(), failed(TIMEOUT)),
    "LeavesDaemons": complete(),
}
SLOW_ONES: dict[str, Says] = {
    "NeverIsMade": failed(TIMEOUT, answered=[0]),
    "NeverAnswers": failed(TIMEOUT),
    "Spins": failed(TIMEOUT),
    "StopsItself": failed(TIMEOUT),
    "Drips": failed(TIMEOUT),
    "Floods": failed(TIMEOUT),
    "Late": failed(TIMEOUT, answered=[1, 2]),
    "PatchesTime": complete(),
}


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    root = tmp_path_factory.mktemp("world")
    with doors(root) as opened:
        compiled_simulator().mkdir(parents=True, exist_ok=True)
        (compiled_simulator() / f"planted-{os.getpid()}").write_text(SECRET)
        made = make_world(root, opened)
        yield made
        for name, door in opened.items():
            with pytest.raises(BlockingIOError):
                door.recv(1) if name in ("udp", "datagrams") else door.accept()
        (compiled_simulator() / f"planted-{os.getpid()}").unlink()


def module_of(file: Path) -> Any:
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class Swept:
    """A finished sweep: results by class, and what outlived its process."""

    by_name: Mapping[str, list[Result]]
    left: list[str]
    temporary: list[str]


def mixed(names: Sequence[str]) -> list[str]:
    """Harmless localizers before, between and after the others."""
    middle = len(names) // 2
    return ["HonestFirst", *names[:middle], "HonestToo", *names[middle:], "HonestLast"]


HONEST = ("HonestFirst", "HonestToo", "HonestLast")


@pytest.fixture(scope="module")
def honest() -> dict[str, bytes]:
    """Estimates of a harmless localizer by walk: the sum of the strides."""
    plugin = module_of(PLUGIN)
    found = {}
    for walk in plugin.WALKS["test"][:2]:
        lengths_m = plugin.load(walk).streams["stride"].rows[:, 1]
        x_m = np.concatenate([[0.0], np.add.accumulate(lengths_m)])
        found[walk] = np.column_stack([np.rint(x_m * 1e4) / 1e4, np.zeros(STEPS)]).tobytes()  # as they are stored
    return found


@pytest.fixture(scope="module")
def runs(world: World, orphans: Any) -> dict[str, Swept]:
    """One walk with every localizer; then two walks each for what leaves notes, and for what looks for them.

    The walks with notes are played one after the other by the same launcher.
    """
    takes_notes = [name for name, kind in PROBES.items() if kind.__module__ == "hostile.notes"]
    with orphans() as adopted:
        found = sweep(
            world,
            {"out": (mixed([*SAYS, *PROBES, *SLOW_ONES]), 1, 2), "notes": (mixed([*takes_notes, "KillsItself"]), 2, 1)},
        )
        left = adopted.left()
    temporary = [path.name for path in world.temporary.iterdir()]
    by_name: dict[str, dict[str, list[Result]]] = {out: {} for out in found}
    for out, results in found.items():
        for result in results:
            by_name[out].setdefault(name_of(result), []).append(result)
    return {out: Swept(by_name[out], left, temporary) for out in found}


@pytest.fixture(scope="module")
def swept(runs: dict[str, Swept]) -> Swept:
    return runs["out"]


def check_around(found: Swept, honest: Mapping[str, bytes], walks: int) -> None:
    for name in HONEST:
        assert len(found.by_name[name]) == walks
        for result in found.by_name[name]:
            complete()(result)
            assert result.estimates.xy_m.tobytes() == honest[result.walk], "the same bytes as without hostile ones"
    assert found.left == [], "processes that outlive the sweep"
    assert found.temporary == [], "files that outlive the sweep"
    for results in found.by_name.values():
        for result in results:
            assert dict(result.provenance["isolation"]).keys() >= {"mode", "held", "missing"}  # type: ignore[call-overload]


def test_walks_of_harmless_localizers_are_unharmed_and_nothing_is_left(swept: Swept, honest: dict[str, bytes]) -> None:
    check_around(swept, honest, walks=1)


@pytest.mark.parametrize("name", SAYS)
def test_harm_is_contained_and_recorded(swept: Swept, name: str) -> None:
    for result in swept.by_name[name]:
        SAYS[name](result)


def check_attempts(result: Result) -> None:
    """An attempt may succeed only where every protection against it is recorded as missing."""
    complete()(result)
    found = int(result.estimates.xy_m[-1, 0])
    isolation = dict(result.provenance["isolation"])  # type: ignore[call-overload]
    for bit, (what, (_, protections)) in enumerate(PROBES[name_of(result)]().attempts().items()):
        held = protections & set(isolation["held"])
        if found >> bit & 1:
            assert protections and not held, f"{what} succeeds, in spite of {sorted(held) or isolation}"
            assert protections & set(isolation["missing"]), f"nothing says that {what} may succeed"


@pytest.mark.parametrize("name", PROBES)
def test_what_is_forbidden_fails(swept: Swept, name: str) -> None:
    for result in swept.by_name[name]:
        check_attempts(result)


def test_every_hostile_localizer_is_tried_and_there_are_enough_of_each_class() -> None:
    assert set(SAYS) | set(SLOW_ONES) | set(PROBES) == {*LOCALIZERS, *FILES_OF}
    assert len(LOCALIZERS) >= MIN_LOCALIZERS
    modules = Counter(kind.__module__ for kind in LOCALIZERS.values())
    assert modules["hostile.two_pass"] >= 10
    number = sum(len(kind().attempts()) for kind in PROBES.values())
    assert number >= 150
    assert all(len(kind().attempts()) <= 52 for kind in PROBES.values()), "as many bits as a number holds exactly"


def test_a_second_pass_is_never_had(swept: Swept) -> None:
    names = [name for name, kind in LOCALIZERS.items() if issubclass(kind, TWO_PASS.TwoPass)]
    for name in names:
        (result,) = swept.by_name[name]
        assert result.provenance["tries"] == 1, name
        assert TWO_PASS.SECOND_PASS not in result.estimates.xy_m[:, 0], name


def test_a_later_walk_finds_no_note(runs: dict[str, Swept], honest: dict[str, bytes]) -> None:
    noted = runs["notes"]
    for name in PROBES.keys() & noted.by_name.keys():
        for result in noted.by_name[name]:
            check_attempts(result)
    for result in noted.by_name["KillsItself"]:
        assert TWO_PASS.SECOND_PASS not in result.estimates.xy_m[:, 0]
    check_around(noted, honest, walks=2)


def test_where_this_system_protects_the_tests_above_say_something(swept: Swept) -> None:
    (result,) = swept.by_name["HonestFirst"]
    isolation = dict(result.provenance["isolation"])  # type: ignore[call-overload]
    if isolation["missing"]:
        pytest.skip(f"not held here: {isolation['missing']}")
    assert isolation["mode"] == "landlock+namespaces+seccomp"


def test_failures_are_cut_and_do_not_reach_for_the_terminal_and_future_times_change_nothing(
    swept: Swept, honest: dict[str, bytes]
) -> None:
    for result in swept.by_name["FutureDated"]:
        assert result.estimates.xy_m.tobytes() == honest[result.walk]
    assert all(len(result.failure) < 20_000 for results in swept.by_name.values() for result in results)
    for result in swept.by_name["Colours"]:
        assert not [c for c in result.failure if (ord(c) < 32 and c not in "\n\t") or 127 <= ord(c) < 160]


def test_time_is_limited(swept: Swept) -> None:
    for name, says in SLOW_ONES.items():
        for result in swept.by_name[name]:
            says(result)
    (patched,) = swept.by_name["PatchesTime"]
    assert patched.step_s[BAD_STEP] >= 0.3, "the clock is the evaluating side's"
    (late,) = swept.by_name["NeverAnswers"]
    assert late.provenance["missed"] == STEPS - BAD_STEP
