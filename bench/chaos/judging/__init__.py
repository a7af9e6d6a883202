# SPDX-License-Identifier: Apache-2.0
"""What happened in a trial, in the order of time, and what must not have happened."""
