"""What runs where nothing of POSIX is: every test here runs an interpreter with `without_posix` on its path."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

from pdrbench.evaluation import evaluate

WITHOUT_POSIX = Path(__file__).parent / "without_posix"


def run(code: str, *arguments: object, folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Runs a program as it would run on Windows; its output is UTF-8 unless `variables` say otherwise."""
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(WITHOUT_POSIX), **variables},
        cwd=folder,
        capture_output=True,
        encoding="utf-8",
        check=False,
    )


def test_every_module_is_imported(tmp_path: Path) -> None:
    code = """
        import importlib, pathlib, sys
        for top in ("pdrbench", "pdrbench_formats", "pdrbench_leaderboard", "pdrbench_sim", "pdrbench_envs"):
            root = pathlib.Path(importlib.import_module(top).__file__).parent
            for file in sorted(root.rglob("*.py")):
                names = [top, *file.relative_to(root).with_suffix("").parts]
                if not names[-1].startswith("__"):
                    importlib.import_module(".".join(names))
        print(sorted({"fcntl", "resource", "termios"} & set(vars(sys.modules["pdrbench.files"]))))
    """
    done = run(code, folder=tmp_path)
    assert (done.returncode, done.stdout.strip()) == (0, "[]"), done.stderr


def test_a_walk_is_the_same_and_none_is_confined(tmp_path: Path) -> None:
    code = """
        import json
        from pdrbench.errors import PdrbenchError
        from pdrbench.evaluation import evaluate
        results = evaluate("dead_reckoning", "CampusStride-v1", split="val", walks=1, seeds=1, progress=True)
        try:
            evaluate("stay", "CampusStride-v1", isolation="confined", walks=1)
        except PdrbenchError as error:
            refused = str(error)
        result = results.results[0]
        print(json.dumps([result.estimates.columns.tobytes().hex(), result.provenance["isolation"], refused]))
    """
    done = run(code, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    estimates, isolation, refused = json.loads(done.stdout)
    (here,) = evaluate("dead_reckoning", "CampusStride-v1", split="val", walks=1, seeds=1, isolation="none").results
    assert estimates == here.estimates.columns.tobytes().hex()
    assert isolation == {"mode": "process", "held": [], "missing": {}}
    assert "confined on Linux only" in refused


def test_locks_of_windows_keep_others_out_and_end_with_their_process(tmp_path: Path) -> None:
    code = """
        import subprocess, sys
        from pdrbench.files import lock, try_lock, unlock
        far = (1 << 56) + 7
        first, second = (open("locks", "a+b", buffering=0) for _ in range(2))
        first.write(b"content")
        lock(first)
        assert try_lock(first, far) and not try_lock(second, far) and not try_lock(second, 0)
        assert try_lock(second, far + 1), "another byte"
        assert second.seek(0) == 0 and second.read() == b"content", "content is read beside locks, places are kept"
        unlock(first, far)
        assert try_lock(second, far)
        held = "from pdrbench.files import lock; f = open('other', 'wb', 0); lock(f); print(flush=True); input()"
        with subprocess.Popen([sys.executable, "-c", held], stdin=-1, stdout=-1) as other:
            other.stdout.readline()
            file = open("other", "rb+", buffering=0)
            assert not try_lock(file, 0)
            other.kill()
        assert try_lock(file, 0)
    """
    done = run(code, folder=tmp_path)
    assert done.returncode == 0, done.stderr


def test_a_console_without_unicode_gets_what_it_can_show(tmp_path: Path) -> None:
    code = """
        import pdrbench.cli
        from pdrbench.cli.output import print_json, say
        def shown():
            say("north → ☃")
            print_json({"walk": "north → ☃"})
        pdrbench.cli.app.command("shown")(shown)
        pdrbench.cli.main(["shown"])
    """
    done = run(code, folder=tmp_path, PYTHONIOENCODING="cp1252")
    assert done.returncode == 0, done.stderr
    line, _, document = done.stdout.partition("\n")
    assert line == "north ? ?"
    assert json.loads(document) == {"walk": "north → ☃"}


def test_without_numba_one_sentence_says_what_to_do(tmp_path: Path) -> None:
    done = run(
        "import sys; sys.modules['numba'] = None; from pdrbench.cli import main; main(['list', 'envs'])",
        folder=tmp_path,
    )
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "pdrbench: numba, which compiles what most localizers and simulators call, is missing: pip install numba"
    ]
