"""Cards with an ArUco tag, as textured meshes that the renderer reads."""

from pathlib import Path
from typing import List, Tuple

import cv2

from merlin_reactive.recognition.tags import TAG, tag_dictionary

CARD = 0.14  # m, edge of the white card around it
CELLS = 6  # of a 4x4 tag with its black border, along an edge
PIXELS = 16  # of the texture, per cell
GAP = 0.002  # m between a thing and its cards


def write_cards(folder: Path, name: str, tag: int, half: Tuple[float, float], rise: float) -> str:
    """Writes four cards, one on each side of an upright thing.

    :param name: of the files, without ending.
    :param half: of the thing's size along x and y, m.
    :param rise: of the cards' middle above the thing's middle, m.
    :return: path of the mesh (Wavefront OBJ).
    """
    black = CELLS * PIXELS
    white = round(black * (CARD - TAG) / TAG / 2)
    dictionary = tag_dictionary()
    if hasattr(cv2.aruco, "generateImageMarker"):  # OpenCV 4.7 and later
        square = cv2.aruco.generateImageMarker(dictionary, tag, black)
    else:
        square = cv2.aruco.drawMarker(dictionary, tag, black)
    card = cv2.copyMakeBorder(square, white, white, white, white, cv2.BORDER_CONSTANT, value=255)
    cv2.imwrite(str(folder / f"{name}.png"), cv2.cvtColor(card, cv2.COLOR_GRAY2BGR))
    (folder / f"{name}.mtl").write_text(
        f"newmtl card\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd {name}.png\n", encoding="ascii"
    )
    lines = [f"mtllib {name}.mtl", "usemtl card", *_quads(half, rise)]
    path = folder / f"{name}.obj"
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    return str(path)


def _quads(half: Tuple[float, float], rise: float) -> List[str]:
    lines = [f"vt {u} {v}" for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))]
    for index, (x, y) in enumerate(((1, 0), (0, 1), (-1, 0), (0, -1))):
        away = (half[0] if x else half[1]) + GAP
        # Seen from outside, (-y, x) points to the right.
        for side, up in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            along = side * CARD / 2
            lines.append(
                f"v {x * away - y * along:.5f} {y * away + x * along:.5f} {rise + up * CARD / 2:.5f}"
            )
        lines.append(f"vn {x} {y} 0")
        corners = [f"{4 * index + k}/{k}/{index + 1}" for k in (1, 2, 3, 4)]
        lines.append("f " + " ".join(corners[:3]))
        lines.append("f " + " ".join((corners[0], corners[2], corners[3])))
    return lines
