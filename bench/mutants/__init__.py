# SPDX-License-Identifier: Apache-2.0
"""What the unit tests catch: modules are changed in small ways, and the tests that notice it are counted."""
