# SPDX-License-Identifier: Apache-2.0
"""Copies a report with its figures and its table of runs into the documentation."""

import shutil
from pathlib import Path
from typing import List

NAME = "experiment"


def publish(results: Path, docs: Path) -> List[Path]:
    """Writes `<docs>/experiment.md` and `<docs>/experiment/`.

    :param results: folder of the experiment, with report.md, runs.csv and figures/.
    :param docs: folder of the documentation.
    :return: The paths written.
    """
    folder = docs / NAME
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    text = (results / "report.md").read_text().replace("](figures/", f"]({NAME}/")
    page = docs / f"{NAME}.md"
    page.write_text(f"{text}\nOne row per run: [{NAME}/runs.csv]({NAME}/runs.csv).\n")
    copied = [results / "runs.csv", *sorted((results / "figures").glob("*.png"))]
    return [page, *(Path(shutil.copy(path, folder)) for path in copied)]
