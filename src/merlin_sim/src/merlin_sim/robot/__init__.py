# SPDX-License-Identifier: Apache-2.0
"""The parts of a simulated robot: base, laser, camera, and a localisation from ground truth."""
