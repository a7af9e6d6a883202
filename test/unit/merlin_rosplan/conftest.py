"""Lets the tests of the planning system import `dispatch_world`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
