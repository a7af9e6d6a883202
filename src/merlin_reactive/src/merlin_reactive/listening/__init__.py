# SPDX-License-Identifier: Apache-2.0
"""Speech recognition: understands one utterance at a time."""
