# SPDX-License-Identifier: Apache-2.0
"""What several modules share is beside them."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
