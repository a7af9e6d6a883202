# SPDX-License-Identifier: Apache-2.0
"""Values, facts, actions and userdata as texts that a page or a terminal can show."""
