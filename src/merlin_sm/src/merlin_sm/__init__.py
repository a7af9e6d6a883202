# SPDX-License-Identifier: Apache-2.0
"""State machines that know the planning system."""
