# SPDX-License-Identifier: Apache-2.0
"""Plans paths, follows them and answers `move_base`."""
