# SPDX-License-Identifier: Apache-2.0
"""Names the one of several cases that a test fails in; rosunit does not report unittest's own subTest."""

import contextlib
from typing import Any, Iterator


@contextlib.contextmanager
def named_case(*what: Any) -> Iterator[None]:
    """Puts what is tried before the text of an assertion that fails within it."""
    try:
        yield
    except AssertionError as error:
        raise AssertionError(f"{', '.join(map(str, what))}: {error}") from error
