# SPDX-License-Identifier: Apache-2.0
"""What was said, heard and seen, and the picture of the last look."""

import zlib
from typing import Any, Dict, Optional, Tuple

import numpy
import pytest
from merlin_msgs.msg import ListenResult
from messages import Reported
from sensor_msgs.msg import Image
from sound_play.msg import SoundRequest

from merlin_monitor.history.pictures import Pictures, png
from merlin_monitor.panels.said import MOST, WIDEST, SaidSection
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import in_english


def section(reported: Optional[Reported] = None) -> Tuple[StateTree, SaidSection, Dict[str, bytes]]:
    tree, pictures = StateTree(), Pictures()
    return tree, SaidSection(tree, pictures, reported if reported is not None else Reported()), pictures


def shown(tree: StateTree) -> Any:
    return [(entry["kind"], in_english(entry["words"])) for entry in tree.get("said", "entries")]


def pixels(picture: bytes) -> Any:
    """RGB of a picture of ours."""
    width, height = (int.from_bytes(picture[at : at + 4], "big") for at in (16, 20))
    begin = picture.index(b"IDAT") + 4
    rows = zlib.decompress(picture[begin : picture.index(b"IEND") - 8])
    return (
        numpy.frombuffer(rows, dtype=numpy.uint8)
        .reshape(height, 1 + 3 * width)[:, 1:]
        .reshape(height, width, 3)
    )


def test_the_newest_comes_first_and_the_oldest_go() -> None:
    reported = Reported()
    tree, said, pictures = section(reported)
    said.spoken(SoundRequest(sound=SoundRequest.SAY, arg=" Hello. "), 1.0)
    said.spoken(SoundRequest(sound=1, arg=""), 1.5)
    said.heard(ListenResult(text="yes", heard=True), 2.0)
    said.heard(ListenResult(text="", heard=True), 3.0)
    said.heard(ListenResult(text="", heard=False), 4.0)
    said.seen(["red_cup", "person", "red_cup"], 5.0)
    said.seen([], 6.0)
    assert shown(tree) == [
        ("seen", "nothing of what it knows"),
        ("seen", "2 × red cup and person"),
        ("heard", "something that was not understood"),
        ("heard", "yes"),
        ("said", "Hello."),
    ]
    assert [(event.kind, event.text, event.at) for event in reported] == [
        ("speech", "said “Hello.”", 1.0),
        ("speech", "heard “yes”", 2.0),
        ("speech", "heard something that was not understood", 3.0),
        ("sight", "saw 2 × red cup and person", 5.0),
        ("sight", "saw nothing of what it knows", 6.0),
    ]
    assert all(in_english(event.detail["said"]) == event.text for event in reported)
    for number in range(2 * MOST):
        said.seen([str(number)], 7.0)
    assert len(shown(tree)) == MOST


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "bgra8"])
def test_the_picture_has_the_colours_of_the_image(encoding: str) -> None:
    tree, said, pictures = section()
    colour = {"rgb8": (200, 100, 50), "bgr8": (50, 100, 200), "bgra8": (50, 100, 200, 255)}[encoding]
    row = bytes(colour) * 3 + b"\0\0"  # rows may be longer than their pixels
    said.image(Image(width=3, height=2, encoding=encoding, step=len(row), data=row * 2))
    assert (pixels(pictures.get("seen")) == (200, 100, 50)).all()
    assert pictures.get("seen", tree.get("said", "picture")) is not None
    said.image(Image(width=3, height=2, encoding="16UC1", step=6, data=b"\0" * 12))
    said.image(Image(width=3, height=20, encoding=encoding, step=len(row), data=row))
    assert pictures.get("seen", tree.get("said", "picture")) is not None


def test_a_large_picture_is_made_smaller() -> None:
    _, said, pictures = section()
    said.image(Image(width=4 * WIDEST, height=8, encoding="rgb8", step=12 * WIDEST, data=bytes(96 * WIDEST)))
    assert pixels(pictures.get("seen")).shape == (2, WIDEST, 3)


def test_grey_with_opacity() -> None:
    assert png(numpy.zeros((2, 3, 2), dtype=numpy.uint8))[25] == 4
