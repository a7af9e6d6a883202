# SPDX-License-Identifier: Apache-2.0
"""What the suites of several folders share."""

#: How long a test waits for what has to come before it fails, s of wall time; for a machine of any speed.
LONG = 300.0
