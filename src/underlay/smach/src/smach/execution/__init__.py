# SPDX-License-Identifier: Apache-2.0
"""How containers are built, run and preempted; SMACH programs use the modules beside this package."""
