# SPDX-License-Identifier: Apache-2.0
"""Compiles tests before workers start, each of which would compile all of them, at the same moment.

pytest keeps tests compiled in a form of its own, which `compileall` does not write.
"""

from pathlib import Path
from typing import Iterable, Iterator

import pytest
from _pytest.assertion import rewrite


def compile_tests(config: pytest.Config, places: Iterable[Path]) -> None:
    """Compiles what has changed; one that cannot be compiled is left to the worker, which says why.

    :param places: files of tests, and folders in which they are looked for.
    """
    for path in sorted(set(_tests(places))):
        compiled = rewrite.get_cache_dir(path) / (path.stem + rewrite.PYC_TAIL)
        if rewrite._read_pyc(path, compiled) is None and rewrite.try_makedirs(compiled.parent):
            try:
                source_hash, code = rewrite._rewrite_test(path, config)
            except (OSError, SyntaxError, ValueError):
                continue
            rewrite._write_pyc(config.stash[rewrite.assertstate_key], code, source_hash, compiled)


def _tests(places: Iterable[Path]) -> Iterator[Path]:
    for place in places:
        if place.is_dir():
            for pattern in ("test_*.py", "conftest.py"):
                yield from place.rglob(pattern)
        elif place.suffix == ".py" and place.is_file():
            yield place
