"""Figures, tables and numbers of README and docs are views of what commands print: `python -m docs.figures`.

    python -m docs.figures                    lists the views: what they show, commands, cost, whether CI checks them
    python -m docs.figures NAME...            runs their commands and writes figures, tables and numbers
    python -m docs.figures --check [NAME...]  compares and writes nothing, exit 1 where something differs; without names
                                              all views that are cheap, as CI does

Commands run in `pdrbench-results/figures/NAME`, which is kept: what was measured before is not measured again.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from docs import overview
from docs.overview import cells

DOCS: Final = Path(__file__).resolve().parent
ROOT: Final = DOCS.parent
SCRATCH: Final = ROOT / "pdrbench-results" / "figures"

Made = dict[Path, bytes]  # by file of the repository


@dataclass(frozen=True)
class View:
    """What one or several commands show on the pages.

    Attributes:
        what: For the list and the gallery.
        commands: As typed, in an empty folder.
        takes: On two cores.
        needs: Beyond the package.
        figures: Pattern of the file that a command draws, by name in `docs/figures`.
        table: Page whose table of claims is written; the reproduction is the name of the view.
        pages: That quote numbers which the commands print, and which are copied by hand.
        make: Makes files from the folder that the commands ran in.
        check: Differences of what is stored to a run of now; None: too expensive for CI.
    """

    what: str
    commands: tuple[str, ...] = ()
    takes: str = "seconds"
    needs: str = ""
    figures: Mapping[str, str] = field(default_factory=dict)
    table: str = ""
    pages: tuple[str, ...] = ()
    make: Callable[[Path], Made] | None = None
    check: Callable[[], list[str]] | None = None


# Tables of claims

HEAD: Final = "| id | what | paper | ours |"
VALUE, VERDICT = 3, 6


def table_of(lines: Sequence[str], name: str = "") -> slice:
    """Where the table of claims stands: the first, or the first below the mark of a reproduction that shares a page."""
    mark = f"<!-- {name} -->"
    below = lines.index(mark) if mark in lines else 0
    begin = next(row for row, line in enumerate(lines) if row >= below and line.startswith(HEAD))
    end = next((row for row in range(begin, len(lines)) if not lines[row].startswith("|")), len(lines))
    return slice(begin, end)


def claims_of(page: str) -> list[list[str]]:
    """The table of claims of a page, without its head."""
    lines = (DOCS / f"{page}.md").read_text(encoding="utf-8").splitlines()
    return [cells(line) for line in lines[table_of(lines)][2:]]


def insert_claims(name: str, page: str, folder: Path) -> Made:
    """A page with the table of a run; prints lines whose value or verdict changed, for what is written about them."""
    path = DOCS / f"{page}.md"
    lines = path.read_text(encoding="utf-8").splitlines()
    made = (folder / name / "claims.md").read_text(encoding="utf-8").splitlines()
    before = {tuple(row[:2]): row for row in map(cells, lines[table_of(lines, name)])}
    for row in map(cells, made[table_of(made)][2:]):
        old = before.get(tuple(row[:2]))
        if old is None or any(old[cell] != row[cell] for cell in (VALUE, VERDICT)):
            say(f"{name}: {' | '.join(row)}\n    {f'was {old[VALUE]}, {old[VERDICT]}' if old else 'is new'}")
    lines[table_of(lines, name)] = made[table_of(made)]
    return {path: ("\n".join(lines) + "\n").encode()}


# Numbers that stand in several places

SUMMED_UP: Final = {  # claims of a page whose values stand in the summary of the paper, and how many digits of each
    "woodman2008": (
        ("error at stances in the wing, 95 %", ".3f"),
        ("particles while tracking, average", ".0f"),
        ("drift learned: error at stances in the wing, 95 %", ".3f"),
    ),
    "frank2009": (
        ("WLAN, 49 passages: mean error", ".2f"),
        ("fused, 49 passages: mean error", ".2f"),
        ("fused and robust: mean error", ".2f"),
        ("at that pace, fused, SHOE: mean error", ".2f"),
    ),
    "koeping2012": (("drift: error with 2000 particles over 50 000", ".2f"),),
    "li2012": (
        ("generic: failures in 40 laps", ".0f"),
        ("personal: failures in 40 laps", ".0f"),
        ("hand, generic: error along the path, mean", ".1f"),
        ("hand, personal: error along the path, mean", ".1f"),
    ),
}


def gates(page: str) -> tuple[int, int]:
    """How many gates of a page hold, and how many there are."""
    passes = [row[VERDICT] for row in claims_of(page)]
    return passes.count("yes"), len(passes) - passes.count("shown")


def numbers(_: Path | None = None) -> Made:
    """README and the summaries of papers and leaderboards, with the numbers of pages, tables and what is registered."""
    from pdrbench.registry import make_task

    readme, summary = ROOT / "README.md", DOCS / "reproduce.md"
    text, lines = readme.read_text(encoding="utf-8"), summary.read_text(encoding="utf-8").splitlines()
    for name, claims in SUMMED_UP.items():
        hold = "{} of {}".format(*gates(name))
        text = put(rf"(?<=\(docs/{name}\.md\))(\s*\()\d+ of \d+", rf"\g<1>{hold}", text)
        ours = {row[1]: row[VALUE].split()[0] for row in claims_of(name)}
        values = iter([format(float(ours[what]), digits) for what, digits in claims])
        (at,) = (i for i, line in enumerate(lines) if line.startswith("| [") and f"reproduce {name}`" in line)
        parts = re.split(r"(?<!\\)\|", lines[at])
        parts[3] = re.sub(r"\d+(?:\.\d+)?", lambda found: next(values, found[0]), parts[3])  # noqa: B023
        parts[4] = f" {hold} gates hold "
        lines[at] = "|".join(parts)
    task = make_task("MallPhone-v2")
    floors = set(_mall_floors())
    count = sum(map(len, task.walks.values()))
    text = put(r"\d+ real phone walks on \d+ floors", f"{count} real phone walks on {len(floors)} floors", text)
    made = {readme: text.encode(), summary: ("\n".join(lines) + "\n").encode()}
    return {**made, overview.PAGE: overview.page()}


def _mall_floors() -> Iterator[str]:
    import csv
    from importlib.resources import files

    table = (files("pdrbench_envs.malls") / "walks.csv").read_text(encoding="utf-8")
    for walk in csv.DictReader(table.splitlines()):
        yield walk["path"].rsplit("/", 2)[0]


def put(pattern: str, replacement: str, text: str) -> str:
    """Replaces the one place that a pattern matches."""
    done, count = re.subn(pattern, replacement, text)
    if count != 1:
        raise SystemExit(f"{pattern} matches {count} places; one was expected: correct docs/figures.py")
    return done


def check_numbers() -> list[str]:
    """Files whose numbers are others."""
    return [
        f"{path.relative_to(ROOT)}: not the numbers of today; write them with: python -m docs.figures numbers"
        for path, made in numbers().items()
        if path.read_bytes() != made
    ]


# Notebooks

NOTEBOOKS: Final = DOCS / "notebooks"
NUMBER: Final = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?")
TOLERANCE: Final = 0.02  # relative; and so much absolute: other systems round otherwise
ESCAPES: Final = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def executed(name: str) -> Any:
    """A notebook, run from top to bottom in an empty folder; raises where a cell does."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    quiet = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}", "COLUMNS": "80"}
    with tempfile.TemporaryDirectory() as folder:
        client = NotebookClient(
            notebook,
            timeout=600,
            startup_timeout=300,  # of a busy machine
            kernel_name="python3",
            coalesce_streams=True,
            record_timing=False,
            resources={"metadata": {"path": folder}},
        )
        client.execute(env={**os.environ, **quiet, "NO_COLOR": "1", "TERM": "dumb"})
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            if output.output_type == "stream":
                output.text = ESCAPES.sub("", output.text)
            else:
                output.metadata = {}
    notebook.metadata = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
    return notebook


def shown(notebook: Any) -> list[tuple[str, str]]:
    """The source of each cell, and what it shows as text; a picture is a word."""
    found = []
    for cell in notebook.cells:
        texts = [
            output.text
            if output.output_type == "stream"
            else "[picture]"
            if "image/png" in output.data
            else output.data.get("text/plain", "")
            for output in cell.get("outputs", ())
        ]
        found.append((cell.source, "\n".join(texts).strip()))
    return found


def differs(stored: str, now: str) -> bool:
    """Whether texts say something else, or a number in them is another by more than the tolerance.

    >>> differs("mean 1.000 m", "mean 1.001 m"), differs("mean 1.0 m", "mean 1.1 m"), differs("mean 1.0", "median 1.0")
    (False, True, True)
    """
    if NUMBER.sub("#", " ".join(stored.split())) != NUMBER.sub("#", " ".join(now.split())):
        return True
    pairs = zip(map(float, NUMBER.findall(stored)), map(float, NUMBER.findall(now)), strict=True)
    return any(abs(a - b) > TOLERANCE * max(abs(a), abs(b), 1.0) for a, b in pairs)


def make_notebook(name: str) -> Made:
    """With the outputs of now."""
    import nbformat

    return {NOTEBOOKS / f"{name}.ipynb": (nbformat.writes(executed(name)) + "\n").encode()}


def check_notebook(name: str) -> list[str]:
    """Cells that show something else than what is stored."""
    import nbformat

    stored = shown(nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4))
    return [
        f"notebooks/{name}.ipynb, cell {number}: stored\n{before}\nnow\n{now}\n"
        for number, ((_, before), (_, now)) in enumerate(zip(stored, shown(executed(name)), strict=True), 1)
        if differs(before, now)
    ]


def notebook(name: str, what: str) -> View:
    """The view of one notebook."""
    return View(what, takes="ten seconds", make=lambda _: make_notebook(name), check=lambda: check_notebook(name))


# Pictures

WIDTH: Final = 640
FRAME_MS, LAST_MS = 220, 2500
COLOURS: Final = 128


def dark(frame: Any) -> Any:
    """The same picture with light and dark exchanged; hues stay."""
    from PIL import Image, ImageChops

    hue, saturation, value = ImageChops.invert(frame).convert("HSV").split()
    turned = Image.merge("HSV", (hue.point(lambda angle: (angle + 128) % 256), saturation, value))
    return turned.convert("RGB").point(lambda level: int(20 + 0.92 * level))


def film(folder: Path) -> Made:
    """The film of the README, light and dark, from what `pdrbench replay` wrote."""
    from PIL import Image, ImageSequence

    with Image.open(folder / "lost.gif") as source:
        whole = [frame.convert("RGB") for frame in ImageSequence.Iterator(source)]
    size = WIDTH, round(WIDTH * whole[0].height / whole[0].width)
    frames = [frame.resize(size, Image.Resampling.LANCZOS) for frame in whole]
    films = {"film_light.gif": frames, "film_dark.gif": [dark(frame) for frame in frames]}
    return {DOCS / "figures" / name: _film(of, folder / name) for name, of in films.items()}


def _film(frames: list[Any], path: Path) -> bytes:
    """One looping film; all frames share their colours."""
    from PIL import Image

    some = frames[:: max(1, len(frames) // 8)]
    mosaic = Image.new("RGB", (some[0].width, some[0].height * len(some)))
    for place, frame in enumerate(some):
        mosaic.paste(frame, (0, place * frame.height))
    palette = mosaic.quantize(COLOURS, method=Image.Quantize.FASTOCTREE)
    plain = [frame.quantize(COLOURS, palette=palette, dither=Image.Dither.NONE) for frame in frames]
    times_ms = [FRAME_MS] * (len(plain) - 1) + [LAST_MS]
    plain[0].save(path, save_all=True, append_images=plain[1:], duration=times_ms, loop=0, optimize=True)
    return path.read_bytes()


CHROMIUM: Final = "chromium --headless --no-sandbox --hide-scrollbars --virtual-time-budget=5000"
BOARD: Final = "CorridorPhone-v1"
DRIFT: Final = "woodman2008_drift-v1 LabStrideLost-v2"


def paper(name: str, what: str, takes: str, *, needs: str = "", page: str = "", **figures: str) -> View:
    """The view of one reproduction."""
    command = f"pdrbench reproduce {name} --jobs 2 --out ."
    drawn = {f"{shown}.png": f"{name}/figures/{file}.png" for shown, file in figures.items()}
    return View(what, (command,), takes, needs, figures=drawn, table=page or name)


VIEWS: Final = {
    "first-comparison": notebook("first-comparison", "Notebook: four localizers on the same walks"),
    "own-localizer": notebook("own-localizer", "Notebook: from adding strides to a particle filter"),
    "own-data": notebook("own-data", "Notebook: own arrays and recordings"),
    "reading-a-result": notebook("reading-a-result", "Notebook: errors, failures and provenance of a walk"),
    "numbers": View(
        "Gates and figures of papers in README and summary, count of walks", make=numbers, check=check_numbers
    ),
    "film": View(
        "The film of the README",
        (
            f"pdrbench run {DRIFT} --split train --walks 6 --seeds 1 --out lost",
            "pdrbench replay lost/*.train-05.*.result --out lost.gif --to 68 --every 6 --fps 6",
        ),
        "some minutes",
        make=film,
    ),
    "leaderboard": View(
        "Pages of a leaderboard",
        (
            f"mkdir -p boards && cp -r {ROOT}/leaderboards/keys.toml {ROOT}/leaderboards/{BOARD} boards",
            "pdrbench leaderboard build --root boards --out site",
            f"{CHROMIUM} --window-size=1340,900 --screenshot=table.png site/{BOARD}/index.html",
            f"{CHROMIUM} --window-size=1340,1250 --screenshot=compare.png "
            f"'file://'$PWD'/site/{BOARD}/compare.html?a=li2012-v0&b=dead_reckoning-v0'",
        ),
        "a minute",
        "Chromium",
        figures={"leaderboard_table.png": "table.png", "leaderboard_compare.png": "compare.png"},
    ),
    "woodman2008": paper(
        "woodman2008", "Woodman & Harle 2008", "twenty minutes", fig4c="fig4c_*", fig4e="fig4e_*", fig9="fig9_pass"
    ),
    "frank2009": paper(
        "frank2009", "Frank et al. 2009", "some minutes", frank2009_cdf="fig7_cdf", frank2009_tracks="fig6_tracks"
    ),
    "koeping2012": paper(
        "koeping2012",
        "Köping et al. 2012",
        "some minutes",
        koeping_movement="movement",
        koeping_over_time="error_over_time",
        koeping_fig2="fig2_error",
        koeping_fig1="fig1_floor",
        koeping_fig4="fig4_linear",
    ),
    "li2012": paper(
        "li2012",
        "Li et al. 2012",
        "some minutes",
        **{f"li2012_{name}": name for name in ("fig7a_heading", "fig7b_heading_cdf", "fig9_plan", "fig11_errors")},
        **{f"li2012_{name}": name for name in ("fig12_tracks", "fig13_turns")},
    ),
    "foot_ins": paper(
        "foot_ins",
        "Inertial navigation on the foot",
        "some minutes",
        needs="recordings of feet",
        **{name: name for name in ("foot_rests", "foot_strides", "foot_capture", "foot_walks", "foot_loops")},
        **{name: name for name in ("foot_heading", "foot_nees")},
    ),
    "foot_left_out": paper(
        "foot_left_out", "The same, each set left out of the fit", "hours", needs="recordings of feet", page="foot_ins"
    ),
    "realism": View(
        "Simulated and recorded signals",
        ("pdrbench validate-sim --out . > scorecard.md",),
        "an hour",
        "recorded sets",
        figures={
            **{f"sim_{name}.png": f"{name}.png" for name in ("signals", "spectra", "variogram", "fields")},
            "sim_heading.png": "heading.png",
        },
        pages=("realism.md",),
    ),
    "learned": View(
        "Networks for stride and heading",
        (
            "python -m pdrbench_baselines.learned train --out run",
            "python -m pdrbench_baselines.learned figures --run run --windows run --out .",
            "python -m pdrbench_baselines.learned measure --split test",
        ),
        "an hour",
        "`pdrbench[learned]`, recorded sets",
        figures={f"learned_{name}.png": f"learned_{name}.png" for name in ("curves", "calibration", "errors")},
        pages=("learned.md",),
    ),
    "speed": View(
        "Timings; they depend on the machine",
        (
            *(
                f"pdrbench bench {name}"
                for name in ("particles", "inertial", "simulate", "radio", "phone", "isolation")
            ),
            *(
                f"python {ROOT}/benchmarks/{name}.py"
                for name in ("bench_env", "bench_evaluate", "bench_read", "bench_waiting")
            ),
        ),
        "half an hour",
        pages=("speed.md",),
    ),
    "error-model": View(
        "Errors of strides",
        ("pdrbench error-model", "pdrbench error-model --law"),
        "some minutes",
        "recordings of feet",
        pages=("error-model.md",),
    ),
    "malls": View(
        "Looks at the sealed malls: one a release, never to refresh a figure",
        ('pdrbench run learned_map-v1 MallPhone-v2 --split test --why "one look per release" --out looks',),
        "an hour",
        "`ilc20_full`",
        pages=("malls.md", "baselines.md"),
    ),
}


def made_by(view: View, name: str, folder: Path) -> Made:
    """The files of a view, from the folder that its commands ran in."""
    made = view.make(folder) if view.make else {}
    for shown_as, pattern in view.figures.items():
        drawn = sorted(folder.glob(pattern))
        if len(drawn) != 1:
            raise SystemExit(f"{name}: {pattern} matches {len(drawn)} files in {folder}; one was expected")
        made[DOCS / "figures" / shown_as] = drawn[0].read_bytes()
    return made | (insert_claims(name, view.table, folder) if view.table else {})


def write(name: str) -> None:
    """Runs the commands of a view and writes its files."""
    view, folder = VIEWS[name], SCRATCH / name
    folder.mkdir(parents=True, exist_ok=True)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for command in view.commands:
        say(f"$ {command}")
        subprocess.run(command, shell=True, cwd=folder, env={**os.environ, "PATH": path}, check=True)
    for path, content in made_by(view, name, folder).items():
        if not path.exists() or path.read_bytes() != content:
            path.write_bytes(content)
            say(f"wrote {path.relative_to(ROOT)}")
    if view.pages:
        say(f"compare with docs/{' and docs/'.join(view.pages)}, by hand")


def listing() -> Iterator[str]:
    """All views for the terminal."""
    for name, view in VIEWS.items():
        yield f"{name}: {view.what} ({view.takes}{f'; needs {view.needs}' if view.needs else ''})"
        yield f"    {'checked by CI' if view.check else 'checked by hand'}: python -m docs.figures {name}"
        yield from (f"        {command}" for command in view.commands)


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m docs.figures", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", choices=[*VIEWS, []], help="views; see the list")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    chosen = parser.parse_args(arguments)
    if not chosen.check:
        for name in chosen.names:
            write(name)
        if not chosen.names:
            say("\n".join(listing()))
        return 0
    failed = False
    for name in chosen.names or [name for name, view in VIEWS.items() if view.check]:
        check = VIEWS[name].check
        if check is None:
            say(f"{name}: checked by hand, with: python -m docs.figures {name}")
            continue
        differences = check()
        failed = failed or bool(differences)
        say("\n".join(differences) or f"{name}: as stored")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
