"""What tasks say of themselves: pieces of Markdown that environments put together."""

from __future__ import annotations

from importlib.resources import files


def describe(*pieces: str, **facts: str) -> str:
    """Pieces by the names of their files, a line between two; `facts` stand for what has braces in them."""
    return "\n".join((files(__name__) / f"{piece}.md").read_text(encoding="utf-8") for piece in pieces).format(**facts)
