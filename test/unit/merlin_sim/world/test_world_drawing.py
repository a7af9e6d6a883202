# SPDX-License-Identifier: Apache-2.0
"""The command draw_world."""

import cv2

from merlin_sim.world.world_drawing import main


def test_a_world_becomes_a_picture(tmp_path):
    picture = tmp_path / "flat.png"
    assert main(["apartment", str(picture)]) == 0
    image = cv2.imread(str(picture))
    assert image.shape[1] > image.shape[0] > 300
    assert len({tuple(pixel) for pixel in image[::7, ::7].reshape(-1, 3)}) > 5


def test_what_cannot_be_drawn_is_said(tmp_path, capsys):
    assert main([str(tmp_path / "none.yaml"), str(tmp_path / "x.png")]) == 1
    assert "none.yaml" in capsys.readouterr().err
    assert main(["apartment", str(tmp_path / "missing" / "x.png")]) == 1
    assert main(["apartment", str(tmp_path / "x.nothing")]) == 1
    assert capsys.readouterr().err.count("draw_world:") == 2
