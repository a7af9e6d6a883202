#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Films the page while the robot of examples/deliberation solves a problem: `make film`.

Usage: tools/in_workspace.sh python tools/film.py [file] [argument:=value …]
The file, docs/images/deliberation.png without one, is an animated PNG; beside it a picture
of the whole page, NAME-page.png.
"""

import io
import sys
import tempfile
import time
from pathlib import Path
from typing import List

from monitor_screenshots import ROOT, page_of
from PIL import Image

from merlin_test.chromium import Visit, chromium

WORDS = ("deliberation", "deliberation.launch", "rtf:=2", "monitor_port:=0")
SIZE = {"width": 1180, "height": 800}
FILMED = (885, 600)
PERIOD = 1.2  # s of wall time between two pictures
SHOWN = 280  # ms for which one is shown
LAST = 3000  # ms, likewise of the last one
COLOURS = 64
LONGEST = 90  # pictures
WHOLE = 20  # the picture at which the whole page is taken, too
LIMIT = 600.0  # s of wall time for the mission


def main() -> int:
    """Runs the mission and writes the film; returns the exit code."""
    words = sys.argv[1:]
    named = [word for word in words if ":=" not in word]
    file = Path(named[0]) if named else ROOT / "docs" / "images" / "deliberation.png"
    pictures: List[Image.Image] = []
    with tempfile.TemporaryDirectory(prefix="merlin_film_") as results:
        run = Path(results, "results", "run.json")  # written at the end
        given = [each for each in words if ":=" in each]
        with page_of(*WORDS, *given, results=results) as address, chromium() as browser:
            visit = Visit(browser, address, viewport=SIZE)
            end = time.monotonic() + LIMIT
            while time.monotonic() < end and not run.is_file():
                began = time.monotonic()
                picture = Image.open(io.BytesIO(visit.page.screenshot())).convert("RGB")
                pictures.append(picture.resize(FILMED, Image.Resampling.LANCZOS))
                if len(pictures) == WHOLE:
                    whole = Image.open(io.BytesIO(visit.page.screenshot(full_page=True))).convert("RGB")
                    whole.quantize(COLOURS).save(file.with_name(f"{file.stem}-page.png"), optimize=True)
                visit.page.wait_for_timeout(max(0.0, 1000 * (began + PERIOD - time.monotonic())))
    write(pictures, file)
    return 0


def write(pictures: List[Image.Image], file: Path) -> None:
    """Writes an animated PNG of evenly chosen pictures, in one palette."""
    stride = -(-len(pictures) // LONGEST)
    chosen = pictures[::stride]
    palette = chosen[len(chosen) // 2].quantize(COLOURS, dither=Image.Dither.NONE)
    frames = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in chosen]
    shown = [SHOWN] * (len(frames) - 1) + [LAST]
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=shown, loop=0, optimize=True)
    print(f"{file}: {len(frames)} of {len(pictures)} pictures, {file.stat().st_size} bytes")


if __name__ == "__main__":
    raise SystemExit(main())
