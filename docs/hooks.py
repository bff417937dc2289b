"""Pages of the documentation that are generated from what is registered."""

from __future__ import annotations

import importlib
import inspect
import pprint
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from docstrings import docstring_markdown, first_sentence
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pages import dataset_pages, fields_page, formats_page, networks_page, notebook_page
from reference import environment_page, localizer_page, metrics_page

from pdrbench.datasets import datasets
from pdrbench.registry import PluginEntry, environments, localizers, make_task

TOOLBOX: Final = ("filters", "inertial", "radio")
ROOMS: Final = (  # whose `__all__` is what may be relied on
    *(f"pdrbench.{room}" for room in (*TOOLBOX, "building", "datasets", "evaluation", "io", "metrics", "picture")),
    *(f"pdrbench.{room}" for room in ("report", "sensors")),
    *(f"pdrbench_formats.{room}" for room in ("derive", "replays", "taskfile")),
)
SITE: Final = {  # page of the site by the file that it is made of, which pages link to: GitHub shows that one
    **{f"../pdrbench/{room}/__init__.py": f"api/{room}.md" for room in TOOLBOX},
    "../pdrbench/metrics/metrics.toml": "metrics.md",
    "../pdrbench/metrics/scoring.py": "api/metrics.md",
    "../envs/README.md": "environments/index.md",
    "../lab/README.md": "reproduce.md",
    "learning.ipynb": "train.md",
    "../lab/pdrbench_lab/outsiders/README.md": "choose.md",
    "../leaderboards/stride/README.md": "choose.md",
    "../envs/pdrbench_envs/wifi_fingerprints.py": "environments/WifiFingerprints-v1.md",
    "../baselines/pdrbench_baselines/learned/MODEL_CARD.md": "networks.md",
}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Adds the generated pages to the navigation."""
    generated = [
        {"Environments": ["environments/index.md", *(f"environments/{name}.md" for name in ours(environments()))]},
        {"Localizers": ["localizers/index.md", *(f"localizers/{name}.md" for name in ours(localizers()))]},
        {"Metrics": "metrics.md"},
        {"Datasets": [f"datasets/{name}.md" for name in datasets()]},
        {"Networks": "networks.md"},
        {"Fields of files": "fields.md"},
        {"API": ["api.md", *(f"api/{_short(room)}.md" for room in ROOMS)]},
        {"Changelog": "changelog.md"},
    ]
    for section in config.nav or []:
        if isinstance(section, dict) and "Reference" in section:
            section["Reference"] += generated
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the generated pages."""
    for path, content in _generated(Path(config.docs_dir).parent):
        files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Fills in the table of registered datasets and the sections of formats; links to the pages of the site."""
    made = {"data.md": ("<!-- datasets -->", _dataset_table), "formats.md": ("<!-- formats -->", formats_page)}
    mark, make = made.get(page.file.src_uri, ("", str))
    markdown = markdown.replace(mark, make()) if mark else markdown
    for source, site in SITE.items():
        markdown = markdown.replace(f"]({source})", f"]({site})")
    return markdown


def ours(entries: Mapping[str, PluginEntry]) -> dict[str, PluginEntry]:
    """What pdrbench itself comes with, whatever else is installed."""
    return {name: entry for name, entry in entries.items() if entry.package == "pdrbench"}


def _short(room: str) -> str:
    return room.rpartition(".")[2]


def _generated(root: Path) -> Iterator[tuple[str, str]]:
    tasks = [make_task(name) for name in ours(environments())]
    rows = [f"| [{task.id}]({task.id}.md) | {task.summary} | {task.licence} |" for task in tasks]
    yield "environments/index.md", _index("Environments", "| id | what | licence |", rows)
    for task in tasks:
        yield f"environments/{task.id}.md", environment_page(task)
    rows = [f"| [{name}]({name}.md) | {_summary(entry.load())} |" for name, entry in ours(localizers()).items()]
    yield "localizers/index.md", _index("Localizers", "| id | what |", rows)
    for name in ours(localizers()):
        yield f"localizers/{name}.md", localizer_page(name)
    yield "metrics.md", metrics_page()
    yield "api.md", _api_page("pdrbench")
    for room in ROOMS:
        yield f"api/{_short(room)}.md", _api_page(room)
    yield "networks.md", networks_page()
    yield "fields.md", fields_page()
    yield "train.md", notebook_page("learning.ipynb")
    yield from dataset_pages()
    yield "changelog.md", (root / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](")


def _index(title: str, head: str, rows: list[str]) -> str:
    rule = "|" + "---|" * (head.count("|") - 1)
    return "\n".join([f"# {title}", "", head, rule, *rows, ""])


def _summary(found: Any) -> str:
    return first_sentence(inspect.getdoc(found) or "").replace("|", "\\|")


def _dataset_table() -> str:
    rows = [
        f"| [`{name}`](datasets/{name}.md) | {found.summary} | {found.licence} | {found.total_bytes / 1e6:.0f} MB | "
        f"{'`data fetch`' if found.is_fetchable else 'by hand'} |"
        for name, found in datasets().items()
    ]
    return "\n".join(["| name | what | licence | size | how to get |", "|---|---|---|---|---|", *rows])


def _api_page(name: str) -> str:
    """Every public name of a package, with its docstring."""
    package = importlib.import_module(name)
    parts = [f"# {name}", docstring_markdown(inspect.getdoc(package) or "")]
    for key in package.__all__:
        if not key.startswith("_"):
            parts += _entry(package, key)
    return "\n\n".join(parts) + "\n"


def _entry(package: ModuleType, name: str) -> list[str]:
    """A class with its members, a function, or a constant with its value."""
    found = getattr(package, name)
    if not callable(found):
        return [f"## {name}", f"```python\n{name} = {pprint.pformat(found, width=100)}\n```"]
    parts = [f"## {name}", f"```python\n{name}{_signature(found)}\n```"]
    return [*parts, docstring_markdown(inspect.getdoc(found) or ""), *(_member(name, *m) for m in _members(found))]


class _Bare(str):
    """An annotation that prints without quotes."""

    __repr__ = str.__str__


def _signature(found: Any) -> str:
    """The signature; one parameter to a line where it is long."""
    try:
        signature = inspect.signature(found)
    except ValueError:
        return ""
    parameters = [p.replace(annotation=_bare(p.annotation)) for p in signature.parameters.values()]
    answer = inspect.Signature.empty if inspect.isclass(found) else _bare(signature.return_annotation)
    text = str(signature.replace(parameters=parameters, return_annotation=answer))
    if len(text) < 90:
        return text
    lines = [str(parameter) for parameter in parameters]
    keyword_only = [p.kind is inspect.Parameter.KEYWORD_ONLY for p in parameters]
    if any(keyword_only):
        lines.insert(keyword_only.index(True), "*")
    tail = "" if answer is inspect.Signature.empty else f" -> {answer}"
    return "(\n" + "".join(f"    {line},\n" for line in lines) + ")" + tail


def _bare(annotation: Any) -> Any:
    return _Bare(annotation) if isinstance(annotation, str) else annotation


def _members(found: Any) -> list[tuple[str, Any]]:
    """Public methods and properties that a class defines itself and documents."""
    if not inspect.isclass(found):
        return []
    return [
        (name, value)
        for name, value in vars(found).items()
        if not name.startswith("_") and isinstance(value, property | type(_members)) and inspect.getdoc(value)
    ]


def _member(owner: str, name: str, value: Any) -> str:
    title = f"### {owner}.{name}"
    if isinstance(value, property):
        return f"{title}\n\n{docstring_markdown(inspect.getdoc(value) or '')}"
    return f"{title}\n\n```python\n{name}{_signature(value)}\n```\n\n{docstring_markdown(inspect.getdoc(value) or '')}"
