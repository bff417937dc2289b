"""The page of formats, made of the docstrings of their readers."""

from __future__ import annotations

import importlib
import inspect
import re
from typing import Final

from pdrbench.io import READERS
from pdrbench_formats.recordings.apps import FOLDER, app_names, app_of

FACTS: Final = ("App", "Files", "Sensors", "Units", "Frame", "Clock", "Traps")
_FACT: Final = re.compile(rf"^({'|'.join(FACTS)}): ", re.M)


def format_facts(name: str) -> dict[str, str]:
    """What the docstring of a reader's module says of a format, by the keys of `FACTS` that stand in it.

    >>> format_facts("phyphox")["App"]
    'phyphox 1.x (iOS, Android).'
    """
    if name in app_names():
        return app_of(FOLDER / f"{name}.toml").facts()
    parts = _FACT.split(_docstring(name))[1:]
    return {key: " ".join(text.split()) for key, text in zip(parts[::2], parts[1::2], strict=True)}


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


def _docstring(name: str) -> str:
    module = READERS.entries()[name].target.partition(":")[0]
    return inspect.getdoc(importlib.import_module(module)) or ""
