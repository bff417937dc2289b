"""Figures of `pdrbench live`: how long until a push is a picture, what a localizer costs, a film; see `main`."""

from __future__ import annotations

import base64
import io
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from conftest import Page, browse  # type: ignore[import-not-found]
from PIL import Image
from streaming import TOKEN, Running, Stroll, make_stroll, running  # type: ignore[import-not-found]

from pdrbench.session import WAIT_S
from pdrbench_formats.live.feeds import Push, decoded
from pdrbench_formats.live.phone import Phone, Setup

PERIOD_S = 0.2
WATCH = """
window.drawn = [];
new MutationObserver(() => drawn.push([Date.now() / 1000, Number(document.getElementById('plan').dataset.time)]))
  .observe(document.getElementById('plan'), {attributes: true, attributeFilter: ['data-time']});
"""


def cost(setup: Setup, stroll: Stroll) -> None:
    """Seconds of processor for a second of walk, all but the network; the second walk, when everything is compiled."""
    for _ in range(2):
        phone, began_s = Phone("phone", setup), time.process_time()
        for end_s in stroll.ends_s:
            phone.take(decoded(stroll.push(end_s), Push))
        phone.end()
        used_s = time.process_time() - began_s
    print(f"{setup.localizer}: {used_s / stroll.walk.end_s:.1%} of a core, {phone.state}")  # noqa: T201


def latency(live: Running, stroll: Stroll, page: Page) -> None:
    """From the beginning of a push, at real time, to the picture of the observation that it makes due."""
    for end_s in stroll.ends_s:  # everything is compiled
        live.post(stroll.push(end_s, device="first"))
    live.ended("first")
    page.open(f"http://127.0.0.1:{live.port}/{TOKEN}/")
    page.run(WATCH)
    began_s, sent = time.time(), []
    for end_s in stroll.ends_s:
        time.sleep(max(0.0, began_s + end_s - time.time()))
        sent.append((end_s, time.time()))
        live.post(stroll.push(end_s, device="second"))
        if len(sent) == 8:
            page.run(
                "const f = document.getElementById('phone'); f.value = 'second'; f.dispatchEvent(new Event('change'))"
            )
    time.sleep(2.0)
    drawn = np.array(page.run("drawn"))
    waits_s = []
    for (end_s, sent_s), (before_s, _) in zip(sent[12:], sent[11:], strict=False):
        # the last row of a packet is earlier than its end, and what is due is earlier than that by more than the wait
        due = [(math.ceil((at_s - WAIT_S) / PERIOD_S - 1e-6) - 1) * PERIOD_S for at_s in (before_s, end_s)]
        if due[1] > due[0]:
            shown = drawn[(drawn[:, 1] >= due[1] - 1e-6) & (drawn[:, 0] >= sent_s), 0]
            waits_s.append(shown.min() - sent_s)
    print(f"{len(waits_s)} pushes: median {np.median(waits_s):.3f} s, p95 {np.percentile(waits_s, 95):.3f} s")  # noqa: T201


def film(live: Running, stroll: Stroll, page: Page, path: Path) -> None:
    """A picture every second of the walk, twice as fast as real time."""
    page.size(390, 640)
    page.open(f"http://127.0.0.1:{live.port}/{TOKEN}/")
    pictures = []
    for k, end_s in enumerate(stroll.ends_s):
        live.post(stroll.push(end_s))
        while k == 8 and not live.server.phones["android"].trail:
            time.sleep(0.1)  # it compiles
        if k % 4 == 0 and k > 8:
            time_s: Any = live.server.phones["android"].trail[-1][4]
            page.wait(f"Number(document.getElementById('plan').dataset.time) >= {time_s} - 0.001")
            shot = page.call("Page.captureScreenshot")["data"]
            pictures.append(
                Image.open(io.BytesIO(base64.b64decode(shot))).convert("RGB").quantize(24, dither=Image.Dither.NONE)
            )
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=500, loop=0, optimize=True)
    print(f"{path}: {len(pictures)} pictures, {path.stat().st_size} bytes")  # noqa: T201


def main(what: str, localizer: str = "fusion", path: str = "live.gif") -> None:
    """`PYTHONPATH=tests:tests/samples python -m pdrbench_lab.speed.live cost|latency|film [LOCALIZER [FILE]]`."""
    with tempfile.TemporaryDirectory() as folder:
        stroll = make_stroll(Path(folder), duration_s=40)
        setup = Setup(localizer, stroll.plan, start=stroll.start, out=Path(folder))
        if what == "cost":
            cost(setup, stroll)
            return
        with running(setup) as live, browse() as page:
            if what == "latency":
                latency(live, stroll, page)
            else:
                film(live, stroll, page, Path(path))


if __name__ == "__main__":
    main(*sys.argv[1:])
