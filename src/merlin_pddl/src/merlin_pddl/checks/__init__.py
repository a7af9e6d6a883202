# SPDX-License-Identifier: Apache-2.0
"""Whether PDDL and plans are right, with kairos where it is installed."""
