"""Lets the tests of the planning system import `dispatch_world` and `execution_store`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
