"""A comparison as one web page that needs no other file and no network."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

TEMPLATE: Final = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>pdrbench comparison</title>
<style>
body { font-family: sans-serif; max-width: 75em; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; margin: 0.5em 0 2em; }
th, td { padding: 0.3em 0.7em; text-align: right; white-space: pre-line; border-bottom: 1px solid #ccc; }
th:first-child, td:first-child { text-align: left; }
img { max-width: 100%; }
</style>
<h1>pdrbench comparison</h1>
{% for title, names, rows in tables %}
<h2>{{ title }}</h2>
<table>
<tr>{% for name in names %}<th>{{ name }}</th>{% endfor %}</tr>
{% for row in rows %}
<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}
</table>
{% endfor %}
{% if notes %}
<ul>
{% for note in notes %}
<li>{{ note }}</li>
{% endfor %}
</ul>
{% endif %}
{% for name, content in pictures %}
<figure><img alt="{{ name }}" src="data:image/png;base64,{{ content }}"><figcaption>{{ name }}</figcaption></figure>
{% endfor %}
</html>
"""


def page(
    tables: Iterable[tuple[str, list[str], list[list[str]]]], notes: Sequence[str], pictures: Iterable[Path]
) -> str:
    """The page.

    Args:
        tables: Title, names of the columns, and cells of each, as `scoreboard.score_tables` gives them.
        notes: Lines below the tables.
        pictures: PNG files, which become part of the page.
    """
    from jinja2 import Environment, StrictUndefined

    template = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True).from_string(TEMPLATE)
    embedded = [(picture.stem, base64.b64encode(picture.read_bytes()).decode()) for picture in pictures]
    return template.render(tables=tables, notes=notes, pictures=embedded)
