# SPDX-License-Identifier: Apache-2.0
"""What a service robot does with its base, laser, camera, loudspeaker and microphone, simulated or real."""
