"""`pdrbench data list|fetch|add|verify|pack`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from pdrbench.cli import list as listing
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say
from pdrbench.errors import DatasetError
from pdrbench.registry import EXCHANGES_GROUP, find_entry, task_place

app = typer.Typer(no_args_is_help=True, help="List, fetch, add and verify recorded datasets.")
app.command("list")(listing.datasets)

LOG_EVERY_FILES: Final = 25  # lines of progress where no terminal shows a bar


@app.command("fetch")
def fetch(
    names: Annotated[
        list[str], typer.Argument(metavar="NAME...", help="Registered datasets, or the address of one packed folder.")
    ],
    sha256: Annotated[
        str | None,
        typer.Option(metavar="HASH", help="Of a packed folder, as `data pack` printed it.", show_default="none"),
    ] = None,
    mirror: Annotated[
        str | None, typer.Option(metavar="URL", help="Fetch NAME/PATH from here instead of from the source of the set.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fetch datasets into the cache folder (PDRBENCH_CACHE) and verify every file.

    An interrupted fetch is continued by the same command.
    """
    from pdrbench.datasets import dataset
    from pdrbench.datasets.download import fetch as fetch_dataset

    if any("://" in name for name in names) or sha256 is not None:
        _fetch_packed(names, sha256, as_json)
        return
    for name in names:
        dataset(name)  # a wrong name is reported before anything is fetched
    answers = []
    for name in names:
        with answer_only(as_json), _progress(name) as progress:
            came = fetch_dataset(name, mirror=mirror, progress=progress)
        answers.append(
            {"id": name, "folder": came.folder, "fetched": list(came.fetched), "recompressed": list(came.recompressed)}
        )
        note(f"{name}: {len(came.fetched)} files fetched, all of it lies in {came.folder}")
        if came.recompressed:
            note(
                f"{name}: {len(came.recompressed)} files hold the registered content in another gzip or xz "
                f"wrapping (this machine's library compresses differently); their content was compared instead"
            )
        note(f"{name}: licence {dataset(name).licence}. {dataset(name).licence_note}")
    if as_json:
        print_json({"datasets": answers})


def _fetch_packed(urls: list[str], sha256: str | None, as_json: bool) -> None:
    fetch_pack = find_entry(EXCHANGES_GROUP, "exchange", "fetch_pack").load()
    if len(urls) != 1 or sha256 is None:
        raise typer.BadParameter("a packed folder is fetched by its address and --sha256, one at a time")
    with answer_only(as_json), _progress(urls[0]) as progress:
        came = fetch_pack(urls[0], sha256, progress)
    if as_json:
        print_json({"datasets": [{"id": came.folder.name, "folder": came.folder, "fetched": list(came.fetched)}]})
    note(f"{len(came.fetched)} files fetched; run it with: pdrbench run LOCALIZER {came.folder}")


@app.command("add")
def add(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A registered dataset that users bring themselves.")],
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Its download, unpacked or as zip.")],
    as_json: AsJson = False,
) -> None:
    """Check and index your own copy of a dataset, and remember where it lies; nothing is copied."""
    from pdrbench.datasets import dataset

    found = dataset(name)
    if found.files:
        raise DatasetError(f"{name}: is fetched, not added: {found.how_to_get or f'pdrbench data fetch {name}'}")
    with answer_only(as_json):
        facts, lines = find_entry(EXCHANGES_GROUP, "exchange", f"add_{name}").load()(folder, note)
    if as_json:
        print_json({"id": name} | facts)
    for line in lines:
        note(line)


@app.command("pack")
def pack(
    task: Annotated[Path, typer.Argument(metavar="TASK", help="Folder with a task.toml, or that file.")],
    out: Annotated[Path, typer.Option(metavar="FOLDER", file_okay=False, help="Folder to make.")],
    as_json: AsJson = False,
) -> None:
    """Write recordings, plan and task file into a folder that others can fetch by its address and hash."""
    with answer_only(as_json):
        write_pack = find_entry(EXCHANGES_GROUP, "exchange", "pack").load()
        place = task_place(str(task))
        if place is None or not place.endswith(".toml"):
            raise DatasetError(f"{task}: only a folder with a task.toml can be packed")
        sha256 = write_pack(Path(place), out)
    if as_json:
        print_json({"folder": out, "sha256": sha256})
    else:
        say(sha256)
    note(f"put {out} on a web server; others then run: pdrbench data fetch URL --sha256 {sha256}")


@contextmanager
def _progress(name: str) -> Iterator[Callable[[int, int, str], None]]:
    """Files done so far: a bar on a terminal, a line now and then in a log."""

    def log(done: int, total: int, path: str) -> None:
        if done % LOG_EVERY_FILES == 0 or done == total:
            note(f"{name}: {done} of {total} files")

    if not sys.stderr.isatty():
        yield log
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bars:
        bar = bars.add_task(name, total=None)
        yield lambda done, total, path: bars.update(bar, completed=done, total=total)


@app.command("verify")
def verify(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Registered datasets; without names all found.")
    ] = None,
    path: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder of the set, where it is not the one found.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare every file of datasets with its registered sha256; exit 1 where one is missing or differs."""
    if path is not None and (names is None or len(names) != 1):
        raise typer.BadParameter("--path is the folder of one dataset: name exactly one")
    answers = [_verified(name, path) for name in names or _available()]
    if as_json:
        print_json({"datasets": answers})
    else:
        for answer in answers:
            verdict = "as registered" if answer["pass"] else "NOT as registered"
            say(f"{answer['id']}: {verdict} ({answer['files']} files, {answer['folder']})")
            for problem in answer["problems"]:
                say(f"  {problem['kind']}: {problem['path']}: {problem['why']}")
    if not all(answer["pass"] for answer in answers):
        raise typer.Exit(1)


def _available() -> list[str]:
    from pdrbench.datasets import datasets, is_available

    names = [name for name in datasets() if is_available(name)]
    if not names:
        raise DatasetError("no dataset is available; run `pdrbench data list`, and `pdrbench data fetch NAME`")
    return names


def _verified(name: str, path: Path | None) -> dict[str, Any]:
    from pdrbench.datasets import dataset, find
    from pdrbench.datasets import verify as verify_dataset

    dataset(name)
    folder = find(name) if path is None else path
    problems = verify_dataset(name, folder)
    return {
        "id": name,
        "folder": folder,
        "files": len(dataset(name).files),
        "pass": all(problem.is_harmless for problem in problems),
        "problems": [{"path": p.path, "kind": p.kind, "why": p.why} for p in problems],
    }
