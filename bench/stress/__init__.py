# SPDX-License-Identifier: Apache-2.0
"""Random cancels and interruptions, also while robots come and go; then all has to be as before."""
