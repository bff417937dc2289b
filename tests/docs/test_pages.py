"""The documentation is correct: the tutorial runs, examples parse, formats and findings are described."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer

import pdrbench_formats
from pdrbench.errors import PdrbenchError
from pdrbench.registry import environments, localizers, make_localizer

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*(ROOT / "docs").glob("*.md"), *ROOT.glob("*/README.md")])
BLOCK = re.compile(r'^```python(?: title="(?P<title>[^"]+)")?\n(?P<code>.*?)^```$', re.MULTILINE | re.DOTALL)
SHELL = re.compile(r"^ *```(?:bash|sh)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)

pytestmark = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="documentation is not part of a wheel")


@pytest.mark.usefixtures("one_figure")
def test_tutorial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Every block in order, in one namespace; a block with a title is written to a file of that name."""
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {}
    for block in BLOCK.finditer((ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")):
        if block["title"]:
            (tmp_path / block["title"]).write_text(block["code"], encoding="utf-8")
        else:
            exec(compile(block["code"], "tutorial.md", "exec"), namespace)
    printed = capsys.readouterr().out
    assert "FAIL" not in printed
    assert "dead_reckoning" in printed
    assert (tmp_path / "mine.png").stat().st_size > 0
    assert any((tmp_path / "report").glob("*-cdf.png"))


def test_ci_runs_every_marked_block_and_each_is_there_once() -> None:
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "README.md", *PAGES)]
    marked = [name for text in texts for name in re.findall(r"<!-- run: (\w+) -->\n```", text)]
    ran = re.findall(
        r"^ *(?:run|run_python|run_rest|marked) (\w+)|; run (\w+)", (ROOT / ".ci" / "run").read_text(), re.MULTILINE
    )
    assert sorted(marked) == sorted({first or second for first, second in ran})


def test_python_examples_parse() -> None:
    for page in PAGES:
        for block in BLOCK.finditer(page.read_text(encoding="utf-8")):
            ast.parse(block["code"], page.name)


def test_every_format_of_recordings_is_described(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs")
    pages = importlib.import_module("pages")
    page = pages.formats_page()
    for name, target in pdrbench_formats.READERS.items():
        if ".recordings." in target:
            assert {"App", "Files", "Sensors", "Units", "Clock", "Traps"} <= pages.format_facts(name).keys(), name
            assert f"### {name}\n" in page


def test_every_finding_is_described() -> None:
    page = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    code = re.compile(r'"(?:error|warning|note)"(?: if \w+(?: > [\d.]+)? else "\w+")?,\s*"([a-z-]+)",')
    folder = Path(str(pdrbench_formats.__file__)).parent
    found = {name for file in folder.rglob("*.py") for name in code.findall(file.read_text(encoding="utf-8"))}
    remedies = tomllib.loads((ROOT / "pdrbench" / "sensors" / "findings.toml").read_text(encoding="utf-8"))
    found = (found | {key.partition(",")[0] for key in remedies}) - {"warning"}
    assert len(found) > 20
    assert [name for name in sorted(found) if f"`{name}`" not in page] == []


def documented_commands() -> list[tuple[str, list[str]]]:
    """Page and words of each `pdrbench` command in a block of a shell."""
    found = []
    for path in (ROOT / "README.md", *PAGES):
        for block in SHELL.findall(path.read_text(encoding="utf-8")):
            for line in block.splitlines():
                for command in line.split("&&"):
                    words = shlex.split(command, comments=True)
                    if words and Path(words[0]).name == "pdrbench":
                        found.append((str(path.relative_to(ROOT)), words[1:]))
    return found


def test_documented_commands_and_options_exist() -> None:
    """Names only; those of the laboratory take anything where it is not installed."""
    from pdrbench import cli

    cli._add_commands()
    root = typer.main.get_command(cli.app)
    wrong = []
    for page, words in documented_commands():
        command: Any = root
        while words and hasattr(command, "commands"):
            command, *words = command.commands.get(words[0]), *words[1:]
        known = {name for param in getattr(command, "params", ()) for name in (*param.opts, *param.secondary_opts)}
        takes_any = command is not None and command.context_settings.get("ignore_unknown_options")
        unknown = [word for word in words if word.startswith("--") and word.partition("=")[0] not in known]
        if command is None or (unknown and not takes_any):
            wrong.append((page, words, unknown))
    assert len(documented_commands()) > 60
    assert wrong == []


def test_documented_ids_are_registered() -> None:
    """Environments and localizers that commands name, but for files and folders of the reader."""
    wrong = []
    for page, words in documented_commands():
        for option, known in (("--env", environments()), ("--localizer", localizers())):
            named = [words[at + 1].partition("?")[0] for at, word in enumerate(words) if word == option]
            wrong += [(page, name) for name in named if not re.search(r"[/.]", name) and name not in known]
    assert [(page, name) for page, name in wrong if not page.startswith("lab/")] == []


def test_choose_names_what_is_registered() -> None:
    """Each localizer that the page recommends, and none of the product is missing from what needs what."""
    page = (ROOT / "docs" / "choose.md").read_text(encoding="utf-8")
    rows = [line.split("|") for line in page.splitlines() if line.startswith("| ")]
    taken = {name for row in rows if len(row) == 8 for name in re.findall(r"`(\w+)`", row[3])}
    needs = {name for row in rows if len(row) == 5 for name in re.findall(r"`(\w+)`", row[1])}
    ours = {name for name, entry in localizers().items() if entry.package == "pdrbench"}
    assert taken <= ours
    assert needs == ours - {"oracle"}


def test_the_first_of_each_board_are_as_they_stand_there() -> None:
    texts = [(ROOT / name).read_text(encoding="utf-8") for name in ("README.md", "docs/choose.md")]
    cells = [line.strip().split("|") for text in texts for line in text.splitlines()]
    rows = [row for row in cells if len(row) == 6 and (ROOT / "leaderboards" / row[1].strip() / "README.md").is_file()]
    pages = {row[1].strip(): ROOT / "leaderboards" / row[1].strip() / "README.md" for row in rows}
    wrong = [row for row in rows if "|".join(["", *row[2:5], ""]) not in pages[row[1].strip()].read_text("utf-8")]
    assert len(rows) > 12 and not wrong


def test_settings_in_documented_ids_exist() -> None:
    """`id?field=value` in pages and in the changelog; of localizers of the product."""
    texts = [path.read_text(encoding="utf-8") for path in (ROOT / "README.md", ROOT / "CHANGELOG.md", *PAGES)]
    named = {name for text in texts for name in re.findall(r"[`']([a-z_0-9]+\?[\w.]+=[\w.&=]+)[`']", text)}
    wrong = []
    for name in sorted(named):
        if name.partition("?")[0] in localizers():
            try:
                make_localizer(name)
            except PdrbenchError as error:
                wrong.append(f"{name}: {error}")
    assert len(named) > 5
    assert wrong == []


def test_the_map_of_the_rooms_has_each_room_in_its_layer() -> None:
    """As the linter of imports has them."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    core = next(one for one in settings["tool"]["importlinter"]["contracts"] if one.get("containers") == ["pdrbench"])
    page = (ROOT / "docs" / "rooms.md").read_text(encoding="utf-8")
    shown: list[set[str]] = []
    for number, rooms in re.findall(r"^\| (\d*) ?\| ((?:`[\w./]+`(?:, )?)+) \|", page, flags=re.MULTILINE):
        names = {name.removesuffix("/").removesuffix(".py") for name in re.findall(r"`([\w./]+)`", rooms)}
        shown = [*shown, names] if number else [*shown[:-1], shown[-1] | names]
    assert shown == [set(layer.split(" | ")) for layer in core["layers"]]
