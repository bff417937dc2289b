"""Changes of a plan by chance, each such as its format invites: what `pdrbench_lab.plans.fuzz` hands to readers.

They take NumPy's generator and the bytes of a file, and return other bytes. Plain changes come from its tests.
"""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from typing import Any, Final

import numpy as np

Files = dict[str, bytes]
MAX_PLAN_BYTES: Final = 300_000  # larger ones are not changed further


def changed_file(rng: np.random.Generator, name: str, content: bytes, other: bytes) -> bytes:
    """A file with one change that its format invites, or a plain one of the tests; `other` lends parts of itself."""
    from plan_mutations import changed  # type: ignore[import-not-found]

    if not content:
        return bytes(rng.bytes(int(rng.integers(1, 40))))
    what = rng.random()
    if what < 0.03:
        return _changed_text(rng, content)
    if what < 0.5:
        head = content[:3]
        if head == b"\x89PN":
            return changed_png(rng, content)
        if head[:2] == b"P5":
            return changed_pgm(rng, content)
        if name.endswith(".dxf"):
            return changed_dxf(rng, content, other)
        if b"<" in content[:200] and b"\0" not in content[:200]:
            return changed_xml(rng, content, other)
        if name.endswith((".json", ".geojson")):
            return changed_document(rng, content, other)
        if name.endswith((".shp", ".dbf", ".shx")):
            return changed_words(rng, content)
    as_json = name + ".geojson" if name.endswith(".json") else name
    return bytes(changed(rng, content, as_json))


def _changed_text(rng: np.random.Generator, content: bytes) -> bytes:
    """Another encoding, a mark of one, an end too early, bytes that are no text, brackets in brackets."""
    what, place = int(rng.integers(6)), int(rng.integers(len(content) + 1))
    if what == 0:
        return content.decode("utf-8", "replace").encode(
            str(rng.choice(["utf-16", "utf-32", "utf-16-be", "utf-8-sig"]))
        )
    if what == 1:
        return content[:place]
    if what == 2:
        return content[:place] + bytes(rng.choice(list(b"\0\xff\xed\xa0\x80\x1a\r"), 3).tolist()) + content[place:]
    if what == 3:
        deep = int(rng.choice([30, 990, 5_000, 100_000]))
        return content[:place] + b"[" * deep + b"]" * deep + content[place:]
    if what == 4:
        deep = int(rng.choice([30, 990, 5_000]))
        return content[:place] + b"<a>" * deep + b"</a>" * deep + content[place:]
    return content + content


def changed_document(rng: np.random.Generator, content: bytes, other: bytes) -> bytes:
    """JSON in which members are moved between documents, repeated many times with a shift, put in lists, or renamed."""
    from plan_mutations import VALUES, pick, places

    try:
        document, lender = json.loads(content), json.loads(other)
    except ValueError:
        return content[::-1] if rng.random() < 0.01 else content
    every, lent = places(document), places(lender)
    if not every or not lent:
        return content
    (node, key), (from_node, from_key) = pick(rng, every), pick(rng, lent)
    what, value = int(rng.integers(6)), node[key]
    if what == 0:
        node[key] = from_node[from_key]
    elif what == 1 and isinstance(value, list) and value:
        shift = float(pick(rng, (0.0, 1e-9, 1e-5, 0.01, 3.0)))
        node[key] = [_moved(one, k * shift) for k in range(int(pick(rng, (3, 30, 300)))) for one in value[:3]]
    elif what == 2:
        for _ in range(int(pick(rng, (1, 2, 20)))):
            value = [value]
        node[key] = value
    elif what == 3 and isinstance(node, dict) and isinstance(from_node, dict):
        node[str(pick(rng, from_node))] = node.pop(key)
    elif what == 4:
        scale = float(pick(rng, (1e-12, 1e-6, 1e3, 1e6, 1e15, 1e300, -1.0)))
        node[key] = _scaled(value, scale)
    else:
        for _ in range(8):
            node, key = pick(rng, every)
            if not isinstance(node, list) or key < len(node):
                node[key] = pick(rng, VALUES)
    return json.dumps(document).encode()


def _moved(node: Any, shift: float) -> Any:
    return _each_number(node, lambda number: number + shift)


def _scaled(node: Any, scale: float) -> Any:
    return _each_number(node, lambda number: number * scale)


def _each_number(node: Any, change: Callable[[float], float]) -> Any:
    if isinstance(node, list):
        return [_each_number(one, change) for one in node]
    if isinstance(node, dict):
        return {key: _each_number(value, change) for key, value in node.items()}
    return change(node) if isinstance(node, float) else node


_ELEMENT: Final = re.compile(rb"<([A-Za-z:_]+)(?:\s[^<>]*)?(?:/>|>(?:(?!<\1[\s>]).)*?</\1>)", re.DOTALL)
_ATTRIBUTE: Final = re.compile(rb"=(?:'[^']*'|\"[^\"]*\")")
_ENTITIES: Final = (
    b"<!DOCTYPE a [<!ENTITY b 'bbbbbbbbbb'><!ENTITY c '&b;&b;&b;&b;&b;&b;&b;&b;'><!ENTITY d '&c;&c;&c;&c;&c;&c;'>]>",
    b"<!DOCTYPE a SYSTEM 'file:///etc/passwd'>",
    b"<?xml version='1.0' encoding='cp037'?>",
    b"<?xml version='1.0' encoding='rot13'?>",
)


def changed_xml(rng: np.random.Generator, content: bytes, other: bytes) -> bytes:
    """XML in which elements are left out, moved, repeated or put in one another, attributes changed, entities added."""
    from plan_mutations import VALUES, pick

    elements, lent = list(_ELEMENT.finditer(content[:MAX_PLAN_BYTES])), list(_ELEMENT.finditer(other[:MAX_PLAN_BYTES]))
    attributes = list(_ATTRIBUTE.finditer(content))
    if not elements or not lent:
        return content
    one, there, what = pick(rng, elements), pick(rng, lent)[0], int(rng.integers(8))
    before, inner, after = content[: one.start()], one[0], content[one.end() :]
    if what == 0:
        return bytes(before + after)
    if what == 1:
        return bytes(before + there + after)
    if what == 2:
        return bytes(before + inner * int(pick(rng, (2, 10, 200))) + after)
    if what == 3:
        return bytes(before + there + inner + after)
    if what == 4 and b">" in inner:
        return bytes(before + inner.replace(b">", b">" + there, 1) + after)
    if what == 5:
        where = content.find(b"?>") + 2 if b"?>" in content[:100] else 0
        return content[:where] + bytes(pick(rng, _ENTITIES)) + content[where:]
    if attributes and rng.random() < 0.1:
        where = pick(rng, attributes).end()
        name: bytes = pick(rng, (b"srsDimension", b"xlink:href", b"gml:id", b"action", b"id", b"lat"))
        return content[:where] + b" " + name + b"='" + str(pick(rng, VALUES)).encode() + b"'" + content[where:]
    if attributes:
        value = pick(rng, attributes)
        text: bytes = pick(rng, attributes)[0] if what == 6 else b"='" + str(pick(rng, VALUES)).encode() + b"'"
        return content[: value.start()] + text + content[value.end() :]
    return content


def changed_dxf(rng: np.random.Generator, content: bytes, other: bytes) -> bytes:
    """A drawing in which pairs of code and value, or whole entities, are changed, left out, repeated or moved."""
    from plan_mutations import VALUES, pick

    pairs, lent = (one.replace(b"\r", b"").split(b"\n") for one in (content, other))
    rows, there = [pairs[k : k + 2] for k in range(0, len(pairs) - 1, 2)], lent
    inside = [k for k, row in enumerate(rows) if row[1] == b"ENTITIES"] or [0]
    starts = [k for k, row in enumerate(rows) if row[0].strip() == b"0" and k > inside[-1]] or [0]
    late = rng.random() < 0.8
    row, what = int(rng.integers(inside[-1] if late else 0, len(rows))), int(rng.integers(7))
    if what == 0:
        rows[row][1] = str(pick(rng, VALUES)).encode()
    elif what == 1:
        rows[row][0] = str(
            pick(rng, (0, 1, 2, 5, 8, 10, 11, 20, 40, 41, 50, 51, 62, 70, 90, 210, 230, 330, -1))
        ).encode()
    elif what == 2:
        del rows[row]
    elif what == 3:
        start = int(rng.choice(starts))
        end = next((k for k in starts if k > start), len(rows))
        rows[start:start] = rows[start:end] * int(pick(rng, (1, 3, 100)))
    elif what == 4 and len(there) > 60:
        start = 2 * int(rng.integers(0, len(there) // 2 - 20))
        rows[row:row] = [there[k : k + 2] for k in range(start, start + 40, 2)]
    elif what == 5:
        kind = pick(rng, ("INSERT", "LWPOLYLINE", "POLYLINE", "CIRCLE", "ARC", "ELLIPSE", "SPLINE", "HATCH", "LINE"))
        name = pick(rng, ("PLAN", "WALLS", "*Model_Space", "", "A-WALL"))
        start = int(rng.choice(starts))
        values = {8: pick(rng, ("A-WALL", "A-DOOR", "0")), 2: name, 10: 0, 20: 0, 40: pick(rng, (1, 1e9, 0, -1))}
        values |= {70: pick(rng, (0, 1, 3, 32767)), 71: pick(rng, (0, 3, 1000)), 11: 5, 21: pick(rng, (5, 1e300))}
        rows[start:start] = [[b"0", kind.encode()], *([str(k).encode(), str(v).encode()] for k, v in values.items())]
    else:
        scale = float(pick(rng, (1e-9, 1e6, 1e30, 1e300, -1)))
        for one in rows[inside[-1] :]:
            if one[0].strip() in (b"10", b"20", b"11", b"21", b"40"):
                try:
                    one[1] = repr(float(one[1]) * scale).encode()
                except ValueError:
                    continue
    return b"\n".join(part for one in rows for part in one) + b"\n"


def changed_png(rng: np.random.Generator, content: bytes) -> bytes:
    """A picture with another head or chunk under a sound sum, or with other pixels."""
    from plan_mutations import pick

    what = int(rng.integers(4))
    if what == 0:
        return _redrawn(rng, content)
    place = 8
    chunks: list[list[bytes]] = []
    while place + 12 <= len(content) and len(chunks) < 100:
        (length,) = struct.unpack(">I", content[place : place + 4])
        chunks.append([content[place + 4 : place + 8], content[place + 8 : place + 8 + length]])
        place += 12 + length
    if not chunks:
        return content
    chosen = chunks[int(rng.integers(len(chunks)))]
    if what == 1 and len(chunks[0][1]) == 13:
        head = list(struct.unpack(">IIBBBBB", chunks[0][1]))
        field = int(rng.integers(7))
        head[field] = pick(
            rng, ((0, 1, 2, 7, 600, 8000, 30_000, 2**31 - 1) if field < 2 else (0, 1, 2, 3, 4, 6, 8, 16))
        )
        chunks[0][1] = struct.pack(">IIBBBBB", *head)
    elif what == 2:
        kind = pick(
            rng, (b"tRNS", b"PLTE", b"gAMA", b"iCCP", b"tEXt", b"zTXt", b"iTXt", b"pHYs", b"acTL", b"fcTL", b"IDAT")
        )
        inner = pick(rng, (b"", b"\0", bytes(256), b"a\0\0" + zlib.compress(bytes(10**7)), rng.bytes(6), chosen[1]))
        chunks.insert(int(rng.integers(len(chunks) + 1)), [kind, inner])
    else:
        at = int(rng.integers(len(chosen[1]) + 1))
        chosen[1] = chosen[1][:at] + rng.bytes(2) + chosen[1][at + 2 :]
    made = content[:8]
    for kind, inner in chunks:
        made += struct.pack(">I", len(inner)) + kind + inner + struct.pack(">I", zlib.crc32(kind + inner))
    return made


def _redrawn(rng: np.random.Generator, content: bytes) -> bytes:
    """Lines, specks, noise, another size or mode: a sound picture of another plan."""
    from PIL import Image, ImageDraw

    try:
        image: Any = Image.open(io.BytesIO(content))
        if image.width * image.height > 4_000_000:
            return content
        image = image.convert("L")
    except (OSError, ValueError, SyntaxError, IndexError, struct.error, zlib.error, Image.DecompressionBombError):
        return content
    draw, what = ImageDraw.Draw(image), int(rng.integers(8))
    for _ in range(int(rng.choice([1, 5, 60]))):
        ends = rng.integers(-20, max(image.size) + 20, 4).tolist()
        draw.line(ends, fill=int(rng.choice([0, 255, 128])), width=int(rng.integers(1, 6)))
    if what == 0:
        pixels = np.asarray(image).copy()
        speckled = rng.random(pixels.shape) < float(rng.choice([0.001, 0.05, 0.5]))
        pixels[speckled] = 255 - pixels[speckled]
        image = Image.fromarray(pixels)
    elif what == 1:
        image = image.resize(tuple(rng.choice([1, 3, 40, 600, 1500], 2).tolist()))
    elif what == 2:
        image = image.convert(str(rng.choice(["1", "P", "RGBA", "LA", "I;16", "CMYK"])).replace("CMYK", "RGB"))
    elif what == 3:
        pixels = 255 - np.asarray(image)
        image = Image.fromarray(pixels)
    elif what > 5:
        image = Image.fromarray(noise(rng))
    made = io.BytesIO()
    image.save(made, "PNG")
    return made.getvalue()


def noise(rng: np.random.Generator) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """(H, W) black and white of at most a million pixels: blocks, blobs, meshes, rings; no plan."""
    from scipy import ndimage

    high, wide = (int(side) for side in rng.choice([300, 600, 900, 1000], 2))
    fraction, size = float(rng.uniform(0.2, 0.9)), int(rng.choice([1, 2, 3, 4, 6, 8, 12, 20, 40]))
    row, column = np.mgrid[:high, :wide]
    what = int(rng.integers(6))
    if what == 0:  # blocks
        blocks = rng.random((high // size + 1, wide // size + 1)) < fraction
        is_bright = np.kron(blocks, np.ones((size, size), bool))[:high, :wide]
    elif what == 1:  # blobs
        smooth = ndimage.gaussian_filter(rng.random((high, wide)), size / 2)
        is_bright = smooth < np.quantile(smooth, fraction)
    elif what == 2:  # a mesh with gaps
        is_line = (row % (4 * size) < 2) | (column % (4 * size) < 2)
        is_bright = ~is_line | (
            ndimage.zoom(rng.random((high // size + 1, wide // size + 1)), size, order=0)[:high, :wide] > fraction
        )
    elif what == 3:  # rings, cut by spokes
        far, turn = np.hypot(row - high / 2, column - wide / 2), np.arctan2(row - high / 2, column - wide / 2)
        is_bright = (far % (2 * size + 2) >= 2) & ((turn * size % 1.0 > 0.05) | (rng.random() < 0.5))
    elif what == 4:  # a chess-board
        is_bright = (row // size + column // size) % 2 > 0
    else:  # one corridor with side corridors
        is_bright = (column % (2 * size + 2) >= 2) | ((row < 9) | (row >= high - 9)) & (
            column // (2 * size + 2) % 2 > 0
        )
    return is_bright.astype(np.uint8) * np.uint8(255)


def changed_pgm(rng: np.random.Generator, content: bytes) -> bytes:
    """A grey map with another head, fewer rows, or other cells."""
    from plan_mutations import pick

    lines = content.split(b"\n", 3)
    if len(lines) < 4:
        return content
    what = int(rng.integers(3))
    if what == 0:
        lines[1] = b" ".join(str(pick(rng, (0, 1, -1, 99, 120, 100, 10**5, 10**9))).encode() for _ in range(2))
    elif what == 1:
        lines[2] = str(pick(rng, (0, 1, 254, 256, 65535, 65536, -1))).encode()
    else:
        cells = bytearray(lines[3])
        for _ in range(int(pick(rng, (1, 20, 2000)))):
            if cells:
                cells[int(rng.integers(len(cells)))] = int(pick(rng, (0, 100, 205, 254, 255)))
        lines[3] = bytes(cells)
    return b"\n".join(lines)


def changed_words(rng: np.random.Generator, content: bytes) -> bytes:
    """A binary file in which a word of four or eight bytes has another value."""
    from plan_mutations import pick

    size, order = (8, "<d") if rng.random() < 0.4 else (4, str(pick(rng, ("<i", ">i"))))
    at = int(rng.integers(0, max(len(content) - size, 1)))
    if order == "<d":
        word = struct.pack(order, pick(rng, (0.0, -1.0, 1e9, 1e300, float("nan"), float("inf"), 3.28)))
    else:
        word = struct.pack(order, pick(rng, (0, 1, 2, 3, 5, 13, 15, 31, 100, 10**6, 2**31 - 1, -1)))
    return content[:at] + word + content[at + size :]


def changed_archive(rng: np.random.Generator, files: Files) -> Files:
    """An archive that lacks a member, names one otherwise, or whose own bytes are changed."""
    name, what = str(rng.choice(sorted(files))), int(rng.integers(4))
    rest = {key: content for key, content in files.items() if key != name}
    if what == 0 and rest:
        return rest
    if what == 1:
        return rest | {
            str(rng.choice(["unit.geojson", "../x", "a" * 300, "x.shp", name.upper(), "é.dbf"])): files[name]
        }
    whole = packed(files)
    at = int(rng.integers(len(whole)))
    return {"": whole[:at] if what == 2 else whole[:at] + rng.bytes(2) + whole[at + 2 :]}


def packed(files: Files) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return made.getvalue()
