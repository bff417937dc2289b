"""The film of the README, light and dark, from what `pdrbench replay` wrote.

pdrbench run woodman2008_drift-v1 LabStrideLost-v1 --split train --walks 6 --seeds 1 --out lost
pdrbench replay lost/*.train-05.*.result --out lost.gif --to 68 --every 6 --fps 6
python docs/film.py lost.gif docs/figures
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image, ImageChops, ImageSequence

WIDTH = 640
FRAME_MS, LAST_MS = 220, 2500
COLOURS = 128


def dark(frame: Image.Image) -> Image.Image:
    """The same with light and dark exchanged; hues stay."""
    hue, saturation, value = ImageChops.invert(frame).convert("HSV").split()
    turned = Image.merge("HSV", (hue.point(lambda angle: (angle + 128) % 256), saturation, value))
    return turned.convert("RGB").point(lambda level: int(20 + 0.92 * level))


def write(frames: list[Image.Image], path: Path) -> None:
    """One looping film; all frames share their colours."""
    some = frames[:: max(1, len(frames) // 8)]
    mosaic = Image.new("RGB", (some[0].width, some[0].height * len(some)))
    for place, frame in enumerate(some):
        mosaic.paste(frame, (0, place * frame.height))
    palette = mosaic.quantize(COLOURS, method=Image.Quantize.FASTOCTREE)
    plain = [frame.quantize(COLOURS, palette=palette, dither=Image.Dither.NONE) for frame in frames]
    times_ms = [FRAME_MS] * (len(plain) - 1) + [LAST_MS]
    plain[0].save(path, save_all=True, append_images=plain[1:], duration=times_ms, loop=0, optimize=True)


def main(source: Path, folder: Path) -> None:
    """Writes `film_light.gif` and `film_dark.gif`."""
    with Image.open(source) as film:
        whole = [frame.convert("RGB") for frame in ImageSequence.Iterator(film)]
    size = WIDTH, round(WIDTH * whole[0].height / whole[0].width)
    frames = [frame.resize(size, Image.Resampling.LANCZOS) for frame in whole]
    write(frames, folder / "film_light.gif")
    write([dark(frame) for frame in frames], folder / "film_dark.gif")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
