# SPDX-License-Identifier: Apache-2.0
"""The system under test: its processes, its network, its witnesses and its client."""
