"""Docstrings in Google layout as Markdown."""

from __future__ import annotations

import re
import textwrap
from typing import Final

SECTIONS: Final = ("Args", "Attributes", "Returns", "Raises", "Yields")


def first_sentence(docstring: str) -> str:
    """The summary: everything up to the first blank line, on one line."""
    return " ".join(docstring.strip().partition("\n\n")[0].split())


def docstring_markdown(docstring: str) -> str:
    """A docstring, as `inspect.getdoc` returns it, as Markdown.

    Sections become bold titles over lists, examples become code blocks, everything else stays as it is.
    """
    return "\n\n".join(_block(block) for block in _blocks(docstring))


def _blocks(docstring: str) -> list[str]:
    """Paragraphs; a section title starts a block that lasts while lines are indented."""
    return [block.strip("\n") for block in re.split(r"\n\s*\n", docstring.strip()) if block.strip()]


def _block(block: str) -> str:
    title, _, body = block.partition("\n")
    if title.rstrip(":") in SECTIONS and title.endswith(":"):
        return f"**{title[:-1]}**\n\n{_items(textwrap.dedent(body))}"
    if block.lstrip().startswith(">>>"):
        return f"```python\n{textwrap.dedent(block)}\n```"
    return block


def _items(body: str) -> str:
    """`name: what` lines as a list; a line that is indented continues the item before it."""
    items: list[str] = []
    for line in body.splitlines():
        if line[:1].isspace() and items:
            items[-1] += " " + line.strip()
        else:
            items.append(re.sub(r"^([\w.*]+(?:, [\w.*]+)*): ", r"`\1`: ", line.strip()))
    return "\n".join(f"* {item}" for item in items)
