# SPDX-License-Identifier: Apache-2.0
"""Lays out the documents and an API reference for mkdocs, and finds links that lead nowhere.

Usage: docs_site.py FOLDER      writes FOLDER/mkdocs.yml and FOLDER/pages, of which `make docs` makes the site
       docs_site.py --check     only looks at the links

The pages lie in FOLDER/pages as in the workspace, with the files that they link to, so every link stays true.
"""

import json
import re
import shutil
import sys
from pathlib import Path
from typing import Dict, Iterator, List, Set, Tuple

WORKSPACE = Path(__file__).resolve().parent.parent
LINK = re.compile(r"(?<!\!)\[[^\]]*\]\(([^)\s]+)\)|!\[[^\]]*\]\(([^)\s]+)\)")
#: Title in the menu → pages, in the order in which they are read.
MENU: Tuple[Tuple[str, Tuple[str, ...]], ...] = (
    (
        "Begin",
        (
            "README.md",
            "docs/hello.md",
            "docs/tutorial.md",
            "docs/museum.md",
            "docs/deliberation.md",
            "docs/testing.md",
            "docs/check.md",
            "docs/troubleshooting.md",
            "docs/glossary.md",
            "docs/real-robot.md",
            "docs/platforms.md",
            "docs/stability.md",
        ),
    ),
    (
        "Reference",
        (
            "docs/states.md",
            "docs/missions.md",
            "docs/schedule.md",
            "docs/explanation.md",
            "docs/for-plansys2-users.md",
            "docs/behaviour-trees.md",
            "docs/planners.md",
            "docs/dispatch.md",
            "docs/several-robots.md",
            "docs/simulation.md",
        ),
    ),
    (
        "Design",
        (
            "docs/architecture.md",
            "docs/work.md",
            "docs/reliability.md",
            "docs/safety.md",
            "docs/reverse-proxy.md",
            "docs/fleet.md",
            "docs/fleet-protocol.md",
            "docs/ontology.md",
        ),
    ),
    ("ROS and ROSPlan", ("docs/ros1.md", "docs/over-rosplan.md", "docs/rosplan-compatibility.md")),
    (
        "Measured",
        (
            "docs/benchmarks.md",
            "docs/reliability-measurements.md",
            "docs/several-robots-measurements.md",
            "docs/fleet-measurements.md",
            "docs/mutants.md",
            "docs/experiment.md",
        ),
    ),
)


def pages() -> List[Path]:
    """All documents."""
    return sorted(
        [WORKSPACE / "README.md", *WORKSPACE.glob("docs/*.md"), *WORKSPACE.glob("src/*/README.md")]
        + [*WORKSPACE.glob("src/underlay/*/README.md"), *WORKSPACE.glob("extras/*/README.md")]
    )


def packages() -> List[Path]:
    """The folders of MERLIN's packages that have a page."""
    found = [*WORKSPACE.glob("src/merlin*/README.md"), *WORKSPACE.glob("extras/merlin*/README.md")]
    return sorted((page.parent for page in found), key=lambda folder: folder.name)


def without_code(text: str) -> str:
    """A page without its code, which has no links."""
    return re.sub(r"`[^`\n]+`", "", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE))


def links(page: Path) -> Iterator[Tuple[str, Path, str]]:
    """The links of a page into the workspace: as written, target, anchor."""
    for match in LINK.finditer(without_code(page.read_text(encoding="utf-8"))):
        link = match[1] or match[2]
        if not re.match(r"\w+:", link):
            path, _, anchor = link.partition("#")
            yield link, ((page.parent / path).resolve() if path else page), anchor


def anchors(page: Path) -> Set[str]:
    """The anchors of a page's headings."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return {anchor(title) for title in re.findall(r"^#+ +(.+?)\s*$", text, re.MULTILINE)}


def anchor(title: str) -> str:
    """The anchor of a heading, as mkdocs and the usual forges make it."""
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower())


def broken() -> List[str]:
    """A line for each link that leads nowhere, and for each page of docs that the menu lacks."""
    found = []
    for page in pages():
        name = page.relative_to(WORKSPACE)
        for link, target, place in links(page):
            if not target.exists():
                found.append(f"{name}: {link}: there is no such file")
            elif place and target.suffix == ".md" and place not in anchors(target):
                found.append(f"{name}: {link}: the page has no such heading")
    listed = {page for _, group in MENU for page in group}
    there = {str(page.relative_to(WORKSPACE)) for page in pages() if page.parent.name == "docs"}
    found += [f"{page}: it is not in the menu of tools/docs_site.py" for page in sorted(there - listed)]
    found += [
        f"{page}: the menu names it, and it does not exist" for page in sorted(listed - there - {"README.md"})
    ]
    return found


def lay_out(site: Path) -> None:
    """Writes the pages and mkdocs' configuration."""
    shutil.rmtree(site, ignore_errors=True)
    for page in pages():
        copy = site / "pages" / page.relative_to(WORKSPACE)
        copy.parent.mkdir(parents=True, exist_ok=True)
        text = page.read_text(encoding="utf-8")
        for link, target, place in links(page):
            if target.is_dir():
                rest = "/README.md" if (target / "README.md").is_file() else "/index.md"
                text = text.replace(
                    f"({link})", f"({link.partition('#')[0].rstrip('/')}{rest}{'#' * bool(place)}{place})"
                )
                if rest == "/index.md":
                    write_listing(target, site)
            elif target.suffix != ".md":
                there = site / "pages" / target.relative_to(WORKSPACE)
                there.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(str(target), str(there))
        copy.write_text(text, encoding="utf-8")
    menu: List[Dict[str, List[str]]] = [{title: list(group)} for title, group in MENU]
    menu.append({"Packages": [f"{package.relative_to(WORKSPACE)}/README.md" for package in packages()]})
    menu.append({"API": [write_reference(package, site) for package in packages()]})
    write_configuration(site, menu)


def write_listing(folder: Path, site: Path) -> None:
    """A page with the names of a folder's files, for links to folders without a page of their own."""
    page = site / "pages" / folder.relative_to(WORKSPACE) / "index.md"
    page.parent.mkdir(parents=True, exist_ok=True)
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith((".", "__")))
    lines = [f"# {folder.relative_to(WORKSPACE)}", "", *(f"- `{name}`" for name in names)]
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_reference(package: Path, site: Path) -> str:
    """The API of a package, from its docstrings; returns the page's name."""
    lines = [f"# {package.name}", ""]
    for file in sorted(package.glob("src/**/*.py")):
        parts = file.relative_to(package / "src").with_suffix("").parts
        if parts[-1] == "__init__":
            parts = parts[:-1]
        if len(parts) > 1:
            lines += [f"::: {'.'.join(parts)}", ""]
    if len(lines) == 2:
        lines.append("Messages, services and actions: its [page](../src/merlin_msgs/README.md).")
    page = site / "pages" / "api" / f"{package.name}.md"
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return f"api/{package.name}.md"


def write_configuration(site: Path, menu: List[Dict[str, List[str]]]) -> None:
    """mkdocs.yml; JSON is YAML."""
    options = {
        "docstring_style": "sphinx",
        "members_order": "source",
        "heading_level": 2,
        "show_source": False,
        "show_root_heading": True,
        "show_root_full_path": True,
        "filters": ["!^_"],
    }
    paths = [str(package / "src") for package in packages()]
    configuration = {
        "site_name": "MERLIN",
        "docs_dir": "pages",
        "site_dir": "html",
        "use_directory_urls": False,  # so that it can be read from a folder, without a server
        "theme": {"name": "material", "font": False, "features": ["navigation.top", "navigation.indexes"]},
        "plugins": [
            "search",
            {"mkdocstrings": {"handlers": {"python": {"paths": paths, "options": options}}}},
        ],
        "markdown_extensions": [
            "tables",
            {"toc": {"permalink": True}},
            {
                "pymdownx.superfences": {
                    "custom_fences": [{"name": "mermaid", "class": "mermaid", "format": "FENCE"}]
                }
            },
        ],
        "validation": {"links": {"anchors": "warn", "not_found": "warn"}, "nav": {"omitted_files": "info"}},
        "nav": menu,
    }
    text = json.dumps(configuration, indent=1)
    text = text.replace('"FENCE"', "!!python/name:pymdownx.superfences.fence_code_format")
    (site / "mkdocs.yml").write_text(text + "\n", encoding="utf-8")


def main() -> int:
    """Lays the site out, or checks the links; returns the exit code."""
    if len(sys.argv) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    found = broken()
    for line in found:
        print(line, file=sys.stderr)
    if sys.argv[1] != "--check" and not found:
        lay_out(Path(sys.argv[1]).resolve())
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
