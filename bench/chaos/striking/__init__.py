# SPDX-License-Identifier: Apache-2.0
"""What is done to a system: one stroke per kind of fault."""
