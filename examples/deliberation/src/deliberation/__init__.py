# SPDX-License-Identifier: Apache-2.0
"""Four problems of deliberation in pyrobosim."""
