# SPDX-License-Identifier: Apache-2.0
"""Where the robot is on its map: a particle filter behind the topics of amcl."""
