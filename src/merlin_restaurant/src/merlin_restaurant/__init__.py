# SPDX-License-Identifier: Apache-2.0
"""The SciRoc restaurant: a robot checks tables, serves orders and guides new clients."""
