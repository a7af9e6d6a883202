# SPDX-License-Identifier: Apache-2.0
"""Recognition of objects, people and tags in a camera image."""
