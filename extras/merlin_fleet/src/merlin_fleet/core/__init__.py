# SPDX-License-Identifier: Apache-2.0
"""The protocol of the fleet: events in, decisions out. Without ROS and without network."""
