# SPDX-License-Identifier: Apache-2.0
"""The question of the action `ask`."""

#: Always the same, so that its length (about 5 s) adds no spread to the results.
QUESTION = "Hello. I came to ask if you need something. Is there anything I can do?"
