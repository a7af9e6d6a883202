"""The fault campaign: breaks a running robot in every way, at every moment, and judges what happens."""
