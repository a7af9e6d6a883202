# SPDX-License-Identifier: Apache-2.0
"""The Executor, its client and the Goal Dispatcher."""
