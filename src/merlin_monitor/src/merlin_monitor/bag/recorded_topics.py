# SPDX-License-Identifier: Apache-2.0
"""How a recording is called, and what it has beside the topics of the robot, below its namespace."""

#: Its file, in the folder of the results.
BAG = "run.bag"

#: All that was known when the recording began, as one change.
KNOWLEDGE = "merlin/recorded/knowledge"
#: The parameters that the page and rviz read, as YAML.
PARAMETERS = "merlin/recorded/parameters"
