"""Pages made of datasets, formats, networks and records, which `docs/hooks.py` adds to the site."""

from __future__ import annotations

import importlib
import inspect
import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from docstrings import docstring_markdown

from pdrbench.datasets import Dataset, datasets
from pdrbench.io import READERS
from pdrbench_formats.recordings.apps import FOLDER, App, app_of

Page = tuple[str, str]  # path in the site and content
DOCS: Final = Path(__file__).resolve().parent
NETWORKS: Final = DOCS.parent / "baselines" / "pdrbench_baselines" / "learned"
RECORDS: Final = {  # files and JSON whose fields are those of a record
    "A result: `Result`": ("pdrbench.result:Result",),
    "Where a localizer was: `Estimates`": ("pdrbench.trajectory:Estimates",),
    "A card: `card.toml`": ("pdrbench_leaderboard.card:Card",),
    "A bundle: `manifest.json`": ("pdrbench_leaderboard.bundle:Manifest",),
    "An entry of a board: `entry.json`": (
        "pdrbench_leaderboard.record:EntryRecord",
        "pdrbench_leaderboard.record:PartRecord",
        "pdrbench_leaderboard.record:DivisionRecord",
    ),
    "The walks of a board: `walks.json`": ("pdrbench_leaderboard.record:PartWalks", "pdrbench_leaderboard.record:Walk"),
    "A board": ("pdrbench_leaderboard.boards:Board", "pdrbench_leaderboard.boards:BoardEnvironment"),
    "A dataset": ("pdrbench.datasets:Dataset", "pdrbench.datasets:DataFile"),
    "A localizer in a folder: `localizer.toml`": (
        "pdrbench.localizer_folder:Settings",
        "pdrbench.localizer_folder:Weights",
    ),
}


def dataset_pages() -> Iterator[Page]:
    """A card for each dataset, from its registered table and `datasets.toml`."""
    cards = tomllib.loads((DOCS / "datasets.toml").read_text(encoding="utf-8"))
    if sorted(cards) != sorted(datasets()):
        raise SystemExit(f"docs/datasets.toml is not on the registered datasets: {set(cards) ^ set(datasets())}")
    users = _environments_of()
    for name, found in datasets().items():
        yield f"datasets/{name}.md", _dataset_card(found, cards[name], users.get(name, []))


def _dataset_card(found: Dataset, card: dict[str, Any], users: list[str]) -> str:
    roles: dict[str, int] = {}
    for file in found.files:
        roles[file.role] = roles.get(file.role, 0) + 1
    rows = {
        "licence": f"{found.licence}. {found.licence_note}",
        "consent": card["consent"],
        "people": card["people"],
        "devices": card["devices"],
        "files": f"{', '.join(f'{count} {role}' for role, count in roles.items())}; {found.total_bytes / 1e6:.1f} MB",
        "source": f"<{found.source_url}>" + (f" at `{found.commit[:12]}`" if found.commit else ""),
        "cite": found.citation,
        "get it": f"`pdrbench data fetch {found.name}`" if found.is_fetchable else found.how_to_get,
        "played by": ", ".join(f"[{env}](../environments/{env}.md)" for env in users) or "no environment of its own",
    }
    table = [f"| **{key}** | {text.strip()} |" for key, text in rows.items()]
    faults = [f"* {fault}" for fault in card["faults"]]
    head = ["| | |", "|---|---|"]
    return "\n".join(
        [f"# {found.name}", "", f"{found.summary}.", "", *head, *table, "", "## Known faults", "", *faults, ""]
    )


def _environments_of() -> dict[str, list[str]]:
    """Environments by the dataset that their data comes from."""
    from pdrbench.registry import environments, make_task

    found: dict[str, list[str]] = {}
    for env, entry in environments().items():
        if entry.package == "pdrbench" and (name := make_task(env).dataset) is not None:
            found.setdefault(name, []).append(env)
    return found


def networks_page() -> str:
    """A card for each network that pdrbench comes with; refuses one without a card."""
    text = (NETWORKS / "MODEL_CARD.md").read_text(encoding="utf-8")
    cards = {card.split()[0]: card for card in re.split(r"^# (?=\S+\.safetensors$)", text, flags=re.MULTILINE)[1:]}
    files = sorted(path.name for path in NETWORKS.glob("*.safetensors"))
    if missing := set(files) - set(cards):
        raise SystemExit(f"MODEL_CARD.md has no card of {sorted(missing)}")
    intro = (
        "# Networks\n\nA card for each network that pdrbench comes with: what it was trained on, people and phones, "
        "figures that are left out of training, limits. `MODEL_CARD.md` beside the weights has the same text. "
        "[Learned displacement](learned.md) says how to use them.\n\n"
    )
    return intro + "\n".join(re.sub(r"^#", "##", f"# {cards[name]}", flags=re.MULTILINE) for name in files)


def notebook_page(name: str) -> str:
    """The cells of a notebook, with the tables, pictures and texts that came out."""
    parts = []
    for cell in json.loads((DOCS / name).read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(text)
            continue
        parts.append(f"```python\n{text}\n```")
        for out in cell["outputs"]:
            shown = {"text/plain": out.get("text", ""), **out.get("data", {})}
            kind = next(kind for kind in ("image/png", "text/html", "text/plain") if kind in shown)
            text = "".join(shown[kind]).replace(' border="1" class="dataframe"', "")  # the theme scrolls plain tables
            as_text = f"```text\n{text}\n```"
            image = f'<img alt="What the cell above draws" src="data:image/png;base64,{text.strip()}">'
            parts.append({"image/png": image, "text/html": text}.get(kind, as_text))
    parts.insert(1, f"[The notebook](./{name})")
    return "\n\n".join(parts) + "\n"


def fields_page() -> str:
    """The fields of every record that a file or JSON holds."""
    import importlib

    parts = [
        "# Fields of files",
        "What stands in the files and the JSON that pdrbench reads and writes, from the records themselves. "
        "[`compare --json`](results.md#json) is described with the results, `task.toml` "
        "[with folders](own-environment.md).",
    ]
    for title, targets in RECORDS.items():
        parts.append(f"## {title}")
        for target in targets:
            module, _, name = target.partition(":")
            record = getattr(importlib.import_module(module), name)
            if len(targets) > 1:
                parts.append(f"### {name}")
            parts += [docstring_markdown(inspect.getdoc(record) or ""), fields_table(record)]
    return "\n\n".join(parts) + "\n"


def fields_table(record: type) -> str:
    """Names, types and defaults of a record, and the comments that its source has on them."""
    said = dict(_comments(inspect.getsource(record)))
    rows = ["| field | type | default | |", "|---|---|---|---|"]
    for name, parameter in inspect.signature(record).parameters.items():
        default = "required" if parameter.default is inspect.Parameter.empty else f"`{parameter.default!r}`"
        rows.append(f"| `{name}` | `{_kind(parameter.annotation)}` | {default} | {said.get(name, '')} |")
    return "\n".join(rows)


def _comments(source: str) -> Iterator[tuple[str, str]]:
    """Comments on fields: behind them, or on the lines above."""
    above = ""
    for line in source.splitlines():
        field = re.match(r"    (\w+): [^#]*(?:#(.*))?$", line)
        if field:
            yield field[1], (field[2] or above).strip().replace("|", "\\|")
        above = f"{above} {line.strip(' #')}" if line.startswith("    # ") else ""


def _kind(annotation: Any) -> str:
    """A type in a cell, without the bounds that its check has."""
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", repr(annotation))
    text = re.sub(r"^Annotated\[(.*), (?:msgspec\.)?Meta\(.*\)\]", r"\1", text)
    return text.replace(" | ", " or ")


FACTS: Final = ("App", "Files", "Sensors", "Units", "Frame", "Clock", "Traps")
_FACT: Final = re.compile(rf"^({'|'.join(FACTS)}): ", re.M)
_APP_SENSORS: Final = ("accel", "gyro", "mag", "rotation", "place", "baro")


def formats_page() -> str:
    """Markdown: a section for each format whose reader states its facts, and a table of the others."""
    sections, others = [], []
    for name in READERS:
        facts = format_facts(name)
        title = (READERS[name].summary or " ".join(_docstring(name).partition("\n\n")[0].split())).rstrip(".")
        if facts:
            rows = [f"| {key} | {facts[key].replace('|', chr(92) + '|')} |" for key in FACTS[1:] if key in facts]
            sections.append("\n".join([f"### {name}", "", f"{title}. {facts['App']}", "", "| | |", "|---|---|", *rows]))
        else:
            others.append(f"| `{name}` | {title.replace('|', chr(92) + '|')} |")
    table = "\n".join(["### Other formats", "", "| name | what |", "|---|---|", *others])
    return "\n\n".join([*sections, table]) + "\n"


def format_facts(name: str) -> dict[str, str]:
    """What the docstring of a reader's module, or the file of an app, says of a format, by the keys of `FACTS`."""
    if (FOLDER / f"{name}.toml").is_file():
        return _facts_of_app(app_of(FOLDER / f"{name}.toml"))
    parts = _FACT.split(_docstring(name))[1:]
    return {key: " ".join(text.split()) for key, text in zip(parts[::2], parts[1::2], strict=True)}


def _facts_of_app(app: App) -> dict[str, str]:
    def listed(value: Any) -> list[str]:
        return [value] if isinstance(value, str) else list(value)

    units = [
        f"{key.removesuffix('_unit')} {' or '.join(dict.fromkeys(listed(value)))}"
        for key, value in app.columns.items()
        if key.endswith("_unit")
    ]
    named = f", in a folder `{'` or `'.join(app.files)}`" if app.files else ""
    beside = f"; `{'`, `'.join(app.truth.files)}` beside it as the reference" if app.truth else ""
    sensors = ", ".join(name for name in _APP_SENSORS if name in app.columns)
    facts = {
        "App": f"{app.app}.",
        "Files": f"one table{named}{beside}.",
        "Sensors": sensors.replace("place", "places as the reference") + ".",
        "Clock": f"`{listed(app.columns['time'])[0].strip('*')}`.",
        "Units": f"{', '.join(units)}; others in those of pdrbench.",
    }
    return facts | ({"Traps": f"{app.traps}."} if app.traps else {})


def _docstring(name: str) -> str:
    module = READERS.entries()[name].target.partition(":")[0]
    return inspect.getdoc(importlib.import_module(module)) or ""
