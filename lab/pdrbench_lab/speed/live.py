"""Figures of `pdrbench live`: how long until a push is a picture, what a localizer costs, a film; see `main`."""

from __future__ import annotations

import base64
import io
import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from conftest import Page, browse  # type: ignore[import-not-found]
from PIL import Image
from streaming import PACKET_S, TOKEN, Running, Stroll, assert_replays, fake_phyphox, make_stroll, running  # type: ignore[import-not-found]
from websockets.sync.client import connect

from pdrbench.registry import make_task
from pdrbench.session import WAIT_S
from pdrbench.task import Task
from pdrbench_formats.live.feeds import Push, decoded
from pdrbench_formats.live.phone import Phone, Setup
from pdrbench_formats.maps.geojson import write
from pdrbench_formats.taskfile.schema import StartTable
from pdrbench_formats.taskfile.survey import Scans, write_survey_table

PERIOD_S = 0.2
FORMATS = ("android", "iphone", "websocket", "phyphox")
NUM_RECORDED = 8
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
        if _due_s(end_s) > _due_s(before_s):
            shown = drawn[(drawn[:, 1] >= _due_s(end_s) - 1e-6) & (drawn[:, 0] >= sent_s), 0]
            waits_s.append(shown.min() - sent_s)
    print(f"{len(waits_s)} pushes: median {np.median(waits_s):.3f} s, p95 {np.percentile(waits_s, 95):.3f} s")  # noqa: T201


def _due_s(end_s: float) -> float:
    """Time of the last observation that a packet makes due: its last row is later than that by more than the wait."""
    return (math.ceil((end_s - WAIT_S) / PERIOD_S - 1e-6) - 1) * PERIOD_S


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
            page.wait(f"Number(document.getElementById('plan').dataset.time) >= {_due_s(end_s)} - 0.001")
            shot = page.call("Page.captureScreenshot")["data"]
            pictures.append(Image.open(io.BytesIO(base64.b64decode(shot))).convert("RGB"))
    palette = pictures[-1].quantize(24)  # one for all, so that no colour flickers
    pictures = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=500, loop=0, optimize=True)
    print(f"{path}: {len(pictures)} pictures, {path.stat().st_size} bytes")  # noqa: T201


def recorded(localizer: str) -> None:
    """Walks of real malls, each in the next of four formats; answers have to be those of `run` on what was recorded."""
    task, rng = make_task("MallPhone-v2"), np.random.default_rng(1)
    for number, name in enumerate(task.split("val")[::11][:NUM_RECORDED]):
        way = FORMATS[number % len(FORMATS)]
        with tempfile.TemporaryDirectory() as folder:
            stroll, setup = _of_recording(task, name, "learned" if way == "phyphox" else localizer, Path(folder))
            phone = _streamed(way, stroll, setup, stroll.unreliable(rng))
            rows = assert_replays(phone, setup.localizer)
        of = f"{len(rows)} of {len(stroll.walk.streams['accel'].rows)} rows"
        print(f"{name} {way}, {setup.localizer}: {len(phone.trail)} answers are those of run, {of}")  # noqa: T201


def _streamed(way: str, stroll: Stroll, setup: Setup, sent: list[float]) -> Phone:
    """The phone that a walk came from, ten times as fast as real time."""
    if way == "phyphox":
        with fake_phyphox(stroll) as (address, handler), running(setup, (address,)) as live:
            while handler.now_s <= stroll.walk.end_s:
                time.sleep(0.1)
            phone: Phone = live.ended(f"phyphox {address[7:]}")
            return phone
    with running(setup) as live:
        if way == "websocket":
            address = f"ws://127.0.0.1:{live.port}/{TOKEN}/stream?device=android"
            with connect(address, proxy=None, max_size=None) as client:
                for end_s in sent:
                    stroll.send(client, end_s)
                    time.sleep(PACKET_S / 10)
        else:
            live.play(sent, lambda end_s: stroll.push(end_s, is_apple=way == "iphone"))
        phone = live.ended("android")
        return phone


def _of_recording(task: Task, name: str, localizer: str, folder: Path) -> tuple[Stroll, Setup]:
    """A walk of an environment with its plan and survey as files."""
    walk = task.load(name)
    briefing = task.brief(walk)
    start, survey = briefing.start, briefing.radio_map
    assert start is not None and briefing.building is not None
    write(briefing.building, folder / "plan.geojson")
    if survey is not None:
        readings = np.column_stack([survey.access_point, survey.rssi_dbm, survey.age_s])
        scans = Scans(survey.xy_m, survey.level, survey.walk, np.diff(survey.first), readings)
        write_survey_table(scans, folder / "survey.csv")
    x_m, y_m = start.xy_m.tolist()
    heading_deg = None if start.heading_rad is None else math.degrees(start.heading_rad)
    begins = StartTable(xy_m=(x_m, y_m), level=start.level, heading_deg=heading_deg)
    stroll = Stroll(walk, folder / "plan.geojson", begins)
    return stroll, Setup(localizer, stroll.plan, tuple(folder.glob("survey.csv")), begins, out=folder, wait_s=1.5)


def main(what: str, localizer: str = "fusion", path: str = "live.gif") -> None:
    """`PYTHONPATH=tests:tests/samples python -m pdrbench_lab.speed.live WHAT [LOCALIZER [FILE]]`.

    WHAT is cost, latency, film or recorded.
    """
    if what == "recorded":
        recorded(localizer)
        return
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
