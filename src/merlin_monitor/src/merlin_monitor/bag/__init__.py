# SPDX-License-Identifier: Apache-2.0
"""Bags that ``record:=true`` has written: what is in them, and the history that is made of one."""
