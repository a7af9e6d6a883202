# SPDX-License-Identifier: Apache-2.0
"""The links of all documents lead somewhere, and the site has every page, folder and package."""

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
_spec = importlib.util.spec_from_file_location("docs_site", ROOT / "tools" / "docs_site.py")
site = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(site)


def test_every_link_leads_somewhere_and_every_page_is_in_the_menu() -> None:
    assert site.broken() == []


def test_a_link_that_leads_nowhere_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "hello.md").write_text("# Hello, MERLIN\n\n```sh\n# not a heading\n```\n")
    (tmp_path / "README.md").write_text(
        "[a](docs/hello.md#hello-merlin) [b](docs/hello.md#not-a-heading) ![c](picture.png)\n"
        "`[d](code)` [e](https://example.org)\n"
    )
    monkeypatch.setattr(site, "WORKSPACE", tmp_path)
    monkeypatch.setattr(site, "MENU", (("Begin", ("README.md", "docs/gone.md")),))
    assert site.broken() == [
        "README.md: docs/hello.md#not-a-heading: the page has no such heading",
        "README.md: picture.png: there is no such file",
        "docs/hello.md: it is not in the menu of tools/docs_site.py",
        "docs/gone.md: the menu names it, and it does not exist",
    ]


def test_the_site_is_laid_out_as_the_workspace(tmp_path: Path) -> None:
    site.lay_out(tmp_path / "site")
    pages = tmp_path / "site" / "pages"
    assert (pages / "docs" / "images" / "mission1.png").is_file(), "what a page shows"
    assert (pages / "LICENSE").is_file() or "LICENSE" not in (ROOT / "README.md").read_text()
    assert "(src/merlin_sm/README.md)" in (pages / "README.md").read_text()
    assert "::: merlin_sm.states.speech" in (pages / "api" / "merlin_sm.md").read_text()
    configuration = (tmp_path / "site" / "mkdocs.yml").read_text()
    menu = json.loads(configuration.replace("!!python/name:pymdownx.superfences.fence_code_format", '""'))[
        "nav"
    ]
    named = [page for group in menu for names in group.values() for page in names]
    assert {"src/merlin_guard/README.md", "extras/merlin_fleet/README.md", "api/merlin_fleet.md"} <= set(
        named
    )
    assert all((pages / page).is_file() for page in named)
