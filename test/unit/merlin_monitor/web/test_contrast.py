# SPDX-License-Identifier: Apache-2.0
"""The colours of the page: text can be read, and lines can be seen (WCAG 2.1, 1.4.3 and 1.4.11)."""

import re
from pathlib import Path
from typing import Dict

import pytest

WEB = Path(__file__).resolve().parents[4] / "src" / "merlin_monitor" / "web"
STYLE = (WEB / "style.css").read_text(encoding="utf-8")
TEXT, LINE = 4.5, 3.0  # least contrasts
SURFACES = ("paper", "card", "sunk")
TEXTS = [(ink, surface) for ink in ("ink", "soft", "accent", "good", "warn", "bad") for surface in SURFACES]
TEXTS += [("accent-ink", "accent"), ("accent", "accent-soft"), ("ink", "accent-soft")]
TEXTS += [("warn", "warn-soft"), ("bad", "bad-soft"), ("ink", "flash"), ("soft", "accent-soft")]
LINES = [(line, surface) for line in ("edge", "accent", "good", "warn", "bad") for surface in SURFACES]


def colours(block: str) -> Dict[str, str]:
    return dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6})", block))


LIGHT = colours(STYLE[: STYLE.index("@media (prefers-color-scheme: dark)")])
DARK = {
    **LIGHT,
    **colours(STYLE[STYLE.index("@media (prefers-color-scheme: dark)") : STYLE.index("* { box")]),
}


def luminance(colour: str) -> float:
    parts = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    red, green, blue = (
        part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_the_measure_is_that_of_the_standard() -> None:
    assert contrast("#ffffff", "#000000") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(("pairs", "least"), [(TEXTS, TEXT), (LINES, LINE)], ids=["text", "lines"])
def test_colours_differ_enough(scheme: str, pairs: list, least: float) -> None:
    named = LIGHT if scheme == "light" else DARK
    found = {f"{ink} on {ground}": round(contrast(named[ink], named[ground]), 2) for ink, ground in pairs}
    assert {words: ratio for words, ratio in found.items() if ratio < least} == {}
