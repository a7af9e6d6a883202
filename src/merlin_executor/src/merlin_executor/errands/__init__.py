# SPDX-License-Identifier: Apache-2.0
"""Which errands are taken where not all can be in time."""
