# SPDX-License-Identifier: Apache-2.0
"""Goals of a fleet: which robot executes which, over an etcd that all robots reach."""

import os

# gRPC writes three lines of its own at each attempt to connect that fails. It reads this when it is imported.
os.environ.setdefault("GRPC_VERBOSITY", "NONE")
