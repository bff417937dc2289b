"""Changes by chance to a plan, member by member, for tests of readers and for the fuzzer of the laboratory."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np

VALUES: tuple[Any, ...] = (
    *(0, -1, 0.5, 1e-9, 1e9, 1e308, float("inf"), float("nan"), 10**20, None, True),
    *("", "0", "-1;0;1", "0-3", [], [[]], {}),
    *("stairs", "room", "area", "wall", "door", "lift", "corridor", 91, -180.5, [0, 0], [[0, 0], [0, 0], [0, 0]]),
)
NUMBER, WORD = re.compile(rb"-?\d+\.?\d*"), re.compile(rb"[A-Za-z_]+")


def pick(rng: np.random.Generator, options: Any) -> Any:
    options = list(options)
    return options[int(rng.integers(len(options)))]


def places(node: Any) -> list[tuple[Any, Any]]:
    """Every member of a JSON document, as what holds it and its key."""
    inner = list(node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ())
    return [place for key, value in inner for place in [(node, key), *places(value)]]


def changed_json(rng: np.random.Generator, document: Any) -> Any:
    """One member replaced, repeated, reversed, scaled, left out, or put in the place of another."""
    every = places(document)
    if not every:
        return document
    (node, key), what = pick(rng, every), int(rng.integers(6))
    value = node[key]
    if what == 0:
        node.pop(key)
    elif what == 1 and isinstance(value, list):
        node[key] = value[::-1] if rng.random() < 0.5 else value * 2
    elif what == 2 and isinstance(value, float):
        node[key] = value * float(pick(rng, (-1.0, 1.0000001, 2.0, 1e-3, 1e3)))
    elif what == 3:
        other, name = pick(rng, every)
        node[key] = json.loads(json.dumps(other[name])) if name in range(len(other)) or isinstance(other, dict) else 0
    else:
        node[key] = pick(rng, VALUES)
    return document


def is_json(content: bytes) -> bool:
    try:
        json.loads(content)
    except ValueError:
        return False
    return True


def changed(rng: np.random.Generator, content: bytes, name: str) -> bytes:
    """A file with one to three changes: of members of JSON, of numbers and words of a text, of bytes of a picture."""
    for _ in range(int(rng.integers(1, 4))):
        numbers, words = list(NUMBER.finditer(content)), list(WORD.finditer(content))
        start, end = sorted(rng.integers(0, len(content) + 1, 2).tolist())
        if name.endswith(".geojson") and rng.random() < 0.9 and is_json(content):
            content = json.dumps(changed_json(rng, json.loads(content))).encode()
        elif name.endswith((".png", ".pgm")):
            content = content[:start] + (rng.bytes(2) if rng.random() < 0.7 else b"") + content[start + 2 :]
        elif rng.random() < 0.4 and numbers:
            found = pick(rng, numbers)
            content = content[: found.start()] + str(pick(rng, VALUES)).encode() + content[found.end() :]
        elif rng.random() < 0.4 and words:
            found = pick(rng, words)
            content = content[: found.start()] + pick(rng, words)[0] + content[found.end() :]
        else:
            again = content[start : min(end, start + 2000)] if rng.random() < 0.5 else b""
            content = content[:start] + again * 2 + content[min(end, start + 200) :]
    return content
