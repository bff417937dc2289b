"""A competition of one's own: a folder with its boards, and apart from it the secret and the key of its hosts."""

from __future__ import annotations

import datetime
import secrets
import shutil
from collections.abc import Sequence
from importlib.resources import files as package_files
from pathlib import Path

import msgspec

from pdrbench import __version__
from pdrbench.errors import BundleError, plain_line
from pdrbench.evaluation.store import make_folder, write_whole
from pdrbench.registry import TASK_FILE, make_task, task_place
from pdrbench.task import HELD_OUT, commitment
from pdrbench_leaderboard.boards import BOARDS_FILE
from pdrbench_leaderboard.rounds import round_secret
from pdrbench_leaderboard.signing import KEYS_FILE, new_key

MASTER_FILE, KEY_FILE = "master.secret", "maintainer.key"
WALKS, HELD_OUT_WALKS = 20, 60  # of a generated environment that has so many, for a first board


def new_competition(folder: Path, environments: Sequence[str], title: str, private: Path) -> list[Path]:
    """Lays out a competition with one board in its first round.

    Args:
        folder: New or empty. Holds what anybody may see, and the recordings of environments that are task folders.
        environments: Ids, or task folders, which are copied.
        title: Of the competition.
        private: New folder for the master secret and the private key.

    Returns:
        Every file of the competition that was written.

    Raises:
        BundleError: A folder holds something already, or the secret would lie among what is published.
        PdrbenchError: There is no such environment.
    """
    folder, private, title = folder.absolute(), private.absolute(), plain_line(title)
    for place in (folder, private):
        if place.exists() and (not place.is_dir() or any(place.iterdir())):
            raise BundleError(f"{place} holds something already: name a new folder")
    if folder in (private, *private.parents):
        raise BundleError(f"{private} lies in {folder}: whoever publishes the one gives away the other")
    lines, names = [], dict[str, Path | None]()
    for spec in environments:
        task, place = make_task(spec), Path(task_place(spec) or "")
        if place.name not in ("", TASK_FILE) or task.id in names:
            raise BundleError(f"{spec}: a board takes a registered id or a task folder, each once")
        names[task.id] = place.parent if place.name == TASK_FILE else None
        lines.append(f'    {{ env = "{task.id}"{_walks(spec) if task.held_out else ""} }},')
    own = {name: source for name, source in names.items() if source is not None}
    make_folder(folder)
    make_folder(private).chmod(0o700)
    for name, source in own.items():
        shutil.copytree(source, folder / name)
    master = secrets.token_hex(32)
    write_whole(private / MASTER_FILE, f"{master}\n".encode())
    (private / MASTER_FILE).chmod(0o600)
    write_whole(private / ".gitignore", b"*\n")  # it may lie in a repository
    keys = new_key(private / KEY_FILE, "maintainer", datetime.datetime.now(datetime.UTC).date())
    digest = commitment(round_secret(master, 0))
    quoted = msgspec.json.encode(title).decode()
    texts = {
        BOARDS_FILE: _template(BOARDS_FILE, title=quoted, environments="\n".join(lines), commitment=digest),
        KEYS_FILE: keys,
        "README.md": _template("README.md", title=title),
        ".github/workflows/pages.yml": _template("pages.yml", version=__version__),
        ".gitignore": "\n".join(["/site/", "# recordings, with their truth", *(f"/{name}/" for name in own), ""]),
    }
    for name, text in texts.items():
        make_folder((folder / name).parent)
        write_whole(folder / name, text.encode())
    return [folder / name for name in texts]


def _walks(spec: str) -> str:
    """How many walks of a generated environment a first board has."""
    task = make_task(spec, secrets.token_hex(32))
    public, held_out = min(WALKS, len(task.split("test"))), min(HELD_OUT_WALKS, len(task.split(HELD_OUT)))
    return f", walks = {public}, held_out_walks = {held_out}"


def _template(name: str, **values: str) -> str:
    text = (package_files("pdrbench_leaderboard") / "competition_files" / name).read_text(encoding="utf-8")
    for key, value in values.items():
        text = text.replace(f"{{{key}}}", value)
    return text
