# SPDX-License-Identifier: Apache-2.0
"""Speech synthesis and sounds behind the interface of sound_play."""
