# SPDX-License-Identifier: Apache-2.0
"""Bags that ``record:=true`` has written: what is in them, and the history that is made of one."""

#: Its file, in the folder of the results.
BAG = "run.bag"

#: All that was known when the recording began, as one change.
KNOWLEDGE = "merlin/recorded/knowledge"
#: The parameters that the page and rviz read, as YAML.
PARAMETERS = "merlin/recorded/parameters"
