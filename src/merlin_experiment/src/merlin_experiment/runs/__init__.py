# SPDX-License-Identifier: Apache-2.0
"""Which runs the experiment is made of, how they are carried out, and the tables they leave."""
