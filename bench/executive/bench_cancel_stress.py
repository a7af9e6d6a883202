# SPDX-License-Identifier: Apache-2.0
"""Many quick cancels and interruptions over plain action servers: does anything break, leak or slow down?

CYCLES=10000 makes the long version (make soak).
"""

import os
from pathlib import Path
from typing import Any, Dict

from executive.cancel_cycles import cancel_cycles


def measure() -> Dict[str, Any]:
    cycles = int(os.environ.get("CYCLES", 1000))
    launch = Path(__file__).with_name("plain_servers.launch")
    return {f"stress_{key}": value for key, value in cancel_cycles(launch, cycles, longest=0.4).items()}
