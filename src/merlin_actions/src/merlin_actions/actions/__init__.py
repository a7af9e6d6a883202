# SPDX-License-Identifier: Apache-2.0
"""Actions that are ready to use in any application."""
