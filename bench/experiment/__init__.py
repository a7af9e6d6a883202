# SPDX-License-Identifier: Apache-2.0
"""The experiment of the paper: which runs it is made of, how they are carried out, and the report on them."""
