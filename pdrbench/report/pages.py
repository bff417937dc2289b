"""Web pages made of templates, that of a comparison among them; texts in `templates/`."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from pdrbench.errors import plain_value


def comparison_page(
    tables: Iterable[tuple[str, list[str], list[list[str]]]], notes: Sequence[str], pictures: Iterable[Path]
) -> str:
    """A comparison as one web page that needs no other file and no network.

    A table is its title, the names of its columns and its cells; pictures are PNG files, which become part of the page.
    """
    embedded = [(picture.stem, base64.b64encode(picture.read_bytes()).decode()) for picture in pictures]
    return render("comparison.html", tables=tables, notes=notes, pictures=embedded)


def render(template: str, *, package: str = "pdrbench.report", **values: Any) -> str:
    """Fills one of `templates/` of a package; what is put into HTML is escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

    environment = Environment(
        loader=PackageLoader(package),
        autoescape=select_autoescape(),
        finalize=plain_value,
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(values)
