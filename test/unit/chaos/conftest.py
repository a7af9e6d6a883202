"""Makes the fault campaign's modules importable; they are a tool, not part of the robot."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "bench"))
