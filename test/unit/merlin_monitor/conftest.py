"""Lets the tests of the monitor import `messages`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
