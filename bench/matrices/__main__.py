# SPDX-License-Identifier: Apache-2.0
"""Prints a table of measurements, for example: `python bench/matrices navigation --seeds 3`."""

import importlib
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

MATRICES = ("listening", "meeting", "navigation", "positioning", "recognition")
EXIT_USAGE = 2


def main() -> int:
    """Runs the matrix that the command line names; returns its exit code."""
    name = sys.argv[1] if len(sys.argv) > 1 else ""
    if name not in MATRICES:
        print(f"usage: python bench/matrices {{{','.join(MATRICES)}}} [options]", file=sys.stderr)
        return EXIT_USAGE
    return int(importlib.import_module(f"matrices.{name}_matrix").main(sys.argv[2:]))


if __name__ == "__main__":
    sys.exit(main())
