# SPDX-License-Identifier: Apache-2.0
"""Runs a script of the tests as lean as MERLIN starts its nodes: ``python3 -m merlin_test SCRIPT …``.

It is the first line of the scripts that suites start. They are kept compiled, which Python does not do with a
script.
"""

import os
import sys
from importlib.machinery import SourceFileLoader
from types import ModuleType

from merlin_test.node_path import LEAN

exec(LEAN)


def main() -> None:
    """Runs the script in the place of this module, with the arguments that follow."""
    del sys.argv[0]
    path = os.path.abspath(sys.argv[0])
    sys.path[0] = os.path.dirname(path)
    module = sys.modules["__main__"] = ModuleType("__main__")
    module.__file__ = path
    code = SourceFileLoader("__main__", path).get_code("__main__")
    assert code is not None, path
    exec(code, vars(module))


main()
